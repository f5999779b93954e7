# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The versions of what a release uploads fit each other, in all places that name them."""

import shutil
import sys

import pytest
import yaml
from paths import ROOT
from project_sources import PYPROJECT

sys.path.insert(0, str(ROOT))
from release import wheels
from release.version_check import contradictions

FILES = ("pyproject.toml", "package.xml", "CHANGELOG.md")
MANIFEST = "messages/src/tf2_msgs/package.xml"


@pytest.fixture
def copied(tmp_path):
    """The files that name versions; a function that replaces a text in one of them."""
    for name in (*FILES, *(f"tools/{name}" for name in FILES), MANIFEST):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)

    def replace(name, old, new):
        text = (tmp_path / name).read_text(encoding="utf-8")
        assert old in text
        (tmp_path / name).write_text(text.replace(old, new, 1), encoding="utf-8")
        return tmp_path

    return replace


def test_the_versions_of_this_checkout_fit_each_other():
    assert contradictions() == []


VERSION = PYPROJECT["project"]["version"]


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("package.xml", f"<version>{VERSION}<", "<version>9.9.9<", "tf2-ros-cython: pyproject.toml says"),
        ("tools/package.xml", "<version>", "<version>9.", "tf2-ros-tools: pyproject.toml says"),
        (
            "tools/pyproject.toml",
            "tf2-ros-cython>=0.1,<0.2",
            "tf2-ros-cython>=9",
            "tf2-ros-cython>=9 does not include",
        ),
        (MANIFEST, "<version>", "<version>9.", "does not include tf2-ros-cython-msgs-jazzy 9."),
    ],
)
def test_a_version_that_does_not_fit_is_named(copied, name, old, new, said):
    assert any(said in line for line in contradictions(copied(name, old, new)))


def test_a_tag_needs_the_version_and_headings_in_the_changelogs(copied):
    root = copied("CHANGELOG.md", "## Unreleased", f"## {VERSION}, 2026-12-01")
    copied("tools/CHANGELOG.md", "## Unreleased", f"## {VERSION}, 2026-12-01")
    assert contradictions(root, f"v{VERSION}") == []
    [said] = contradictions(root, "v9.9.9")
    assert said == f"the tag is v9.9.9, and pyproject.toml says {VERSION}"
    shutil.copy(ROOT / "CHANGELOG.md", root / "CHANGELOG.md")
    assert contradictions(root, f"v{VERSION}") == [
        f"tf2-ros-cython: CHANGELOG.md has no heading for {VERSION}"
    ]


def test_messages_are_published_for_the_releases_that_an_extra_installs():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "wheels.yml").read_text(encoding="utf-8"))
    published = workflow["jobs"]["messages"]["strategy"]["matrix"]["ros"]
    assert published == [release for release, extras in wheels.RELEASES.items() if extras]
    extras = PYPROJECT["project"]["optional-dependencies"]
    named = {text for texts in extras.values() for text in texts if "-msgs-" in text}
    assert {text.partition(">")[0] for text in named} == {f"tf2-ros-cython-msgs-{one}" for one in published}
