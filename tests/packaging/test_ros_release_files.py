# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What rosdistro, bloom and docs.ros.org read: the manifest, the changelog, and how the site is built."""

import re
import subprocess
import sys
from importlib.util import find_spec

import pytest
import yaml
from paths import ROOT

pytestmark = pytest.mark.skipif(not (ROOT / ".git").exists(), reason="this is not a clone")

sys.path.insert(0, str(ROOT))
from release import changelog_rst  # noqa: E402

REPOSITORY = "https://github.com/robots/tf2-ros-cython"


@pytest.mark.long("needs catkin_pkg")
def test_the_tools_of_ros_read_each_entry_of_the_changelog(tmp_path):
    changelog = pytest.importorskip("catkin_pkg.changelog")
    ours = (
        (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").replace("## Unreleased", "## 9.0.0, 2030-01-01")
    )
    file = tmp_path / "CHANGELOG.rst"
    file.write_text(changelog_rst.converted(ours, REPOSITORY), encoding="utf-8")
    read = changelog.get_changelog_from_path(str(file), "tf2_ros_cython")
    entries = read.get_content_of_version("9.0.0")
    section = ours.partition("## 9.0.0")[2].partition("\n## ")[0]
    bullets = [bullet for entry in entries for bullet in getattr(entry, "bullets", ())]
    assert len(bullets) == len(re.findall(r"^- ", section, re.MULTILINE)) > 0


@pytest.mark.long("needs catkin_pkg")
def test_the_tools_of_ros_accept_the_manifests():
    package = pytest.importorskip("catkin_pkg.package")
    for manifest in ("package.xml", "tools/package.xml", "messages/src/tf2_msgs/package.xml"):
        warnings = []
        read = package.parse_package(str(ROOT / manifest), warnings=warnings)
        assert warnings == []
        assert {url.type for url in read.urls} == {"website", "repository", "bugtracker"}
        assert read.authors and read.maintainers


def test_the_manifest_names_the_settings_of_the_site():
    manifest = (ROOT / "package.xml").read_text(encoding="utf-8")
    name = re.search(r"<rosdoc2>(.+)</rosdoc2>", manifest)[1]
    head, settings = yaml.safe_load_all((ROOT / name).read_text(encoding="utf-8"))
    assert head == {"type": "rosdoc2 config", "version": 1}
    [builder] = settings["builders"]
    folder = ROOT / builder["sphinx"]["sphinx_sourcedir"]
    assert (folder / "conf.py").is_file()
    assert (folder / "docs" / "index.md").samefile(ROOT / "docs" / "index.md")


@pytest.mark.long("builds the site as docs.ros.org does")
@pytest.mark.skipif(find_spec("rosdoc2") is None, reason="needs rosdoc2")
def test_the_site_of_docs_ros_org_is_built_without_warnings(tmp_path):
    places = {option: tmp_path / option.strip("-") for option in ("-o", "-c", "-d")}
    program = "import sys; from rosdoc2.main import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", program, "build", "--package-path", ROOT]
    ended = subprocess.run(
        [*command, *(word for item in places.items() for word in item)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert ended.returncode == 0, ended.stderr
    assert [line for line in ended.stderr.splitlines() if "WARNING" in line] == []
    site = tmp_path / "o" / "tf2_ros_cython"
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / "tools" / "docs").glob("*.md"), ROOT / "README.md"]
    wanted = {str(page.relative_to(ROOT).with_suffix(".html")) for page in pages}
    assert wanted <= {str(path.relative_to(site)) for path in site.rglob("*.html")}
