# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a release needs of its owner, and what `make release-check` finds in what it would upload."""

import re
import shutil
import subprocess
import sys

import pytest
from paths import ROOT

pytestmark = pytest.mark.skipif(not (ROOT / ".git").exists(), reason="this is not a clone")

sys.path.insert(0, str(ROOT))
from release import owner, release_check  # noqa: E402

FACTS = """
repository = "https://github.com/robots/tf2-ros-cython"
maintainer = "Ada Robot"
contact = "ada@robots.example"
github_accounts = ["ada", "bob"]
"""


@pytest.fixture
def filled_in(tmp_path):
    """The files that hold the owner's facts, in a repository whose owner has filled them in."""
    for name in owner.tracked_files(ROOT):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / "release" / "owner.toml").write_text(FACTS)
    for command in (["init", "--quiet"], ["add", "."]):
        subprocess.run(["git", *command], cwd=tmp_path, check=True)
    for name, text in owner.stale(tmp_path).items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_the_owners_facts_are_the_same_in_all_files():
    assert [*owner.stale()] == []


def test_once_filled_in_no_file_waits_for_the_owner(filled_in):
    assert release_check.not_filled_in(filled_in) == []


def test_what_is_not_filled_in_is_named(filled_in):
    (filled_in / "release" / "owner.toml").write_text(FACTS.replace("ada@robots.example", "ada@example.org"))
    (filled_in / "docs" / "limits.md").write_text("git clone https://example.org/tf2")
    found = release_check.not_filled_in(filled_in)
    assert "release/owner.toml: contact = 'ada@example.org'" in found
    assert "package.xml: run python -m release.owner" in found
    assert "docs/limits.md contains a placeholder of owner.toml" in found


def test_the_links_of_a_page_that_pypi_shows_are_absolute_and_lead_to_files(filled_in):
    for address in ("robots/tf2-ros-cython", "moved/tf2"):
        facts = FACTS.replace("robots/tf2-ros-cython", address)
        (filled_in / "release" / "owner.toml").write_text(facts)
        for name, text in owner.stale(filled_in).items():
            (filled_in / name).write_text(text)
        for name in owner.SHOWN_BY_PYPI:
            text = (filled_in / name).read_text()
            assert [link[0] for link in owner.LINK.finditer(text) if link["path"]] == []
            ours = re.findall(rf"\(https://github.com/{address}/(?:blob|raw|tree)/main/([^)#]+)", text)
            assert ours
            assert [path for path in ours if not (ROOT / path).exists()] == []
        assert owner.stale(filled_in) == {}
