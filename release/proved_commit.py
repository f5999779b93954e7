# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Find what has changed since a commit was proved, beyond what every release changes."""

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

PAGE = Path("docs", "development", "proofs.md")
MAY_DIFFER = [PAGE, "CHANGELOG.md", "CHANGELOG.rst", "tools/CHANGELOG.md"]
VERSIONED = ["*pyproject.toml", "*package.xml", "release/conda/recipe.yaml"]
VERSION = re.compile(r'^( *version(?: =|:) "|  <version>)[\d.]+', re.MULTILINE)


def changed_since(commit, root):
    """The files in which HEAD differs from a commit by more than versions and what owner.toml says."""
    with tempfile.TemporaryDirectory() as folder:
        place = clone(root, commit, Path(folder, "clone"))
        facts = git(root, "show", "HEAD:release/owner.toml")
        trees = [_compared_tree(place, one, facts) for one in (commit, git(root, "rev-parse", "HEAD"))]
        return git(place, "diff", "--name-only", *trees).splitlines()


def _compared_tree(place, commit, facts):
    """The id of a commit's tree with these facts of the owner, and without what may differ."""
    from release import owner  # which needs tomli with Python 3.10

    git(place, "checkout", "--quiet", "--force", commit)
    (place / "release" / "owner.toml").write_text(facts, encoding="utf-8")
    for name, text in owner.stale(place).items():
        (place / name).write_text(text, encoding="utf-8")
    for name in MAY_DIFFER:
        (place / name).unlink(missing_ok=True)
    for name in git(place, "ls-files", *VERSIONED).splitlines():
        text = (place / name).read_text(encoding="utf-8")
        (place / name).write_text(VERSION.sub(r"\1", text), encoding="utf-8")
    git(place, "add", "--all")
    return git(place, "write-tree")


def clone(root, commit, place):
    """A new clone of a commit."""
    shutil.rmtree(place, ignore_errors=True)
    git(root, "clone", "--quiet", "--no-checkout", root, place)
    git(place, "checkout", "--quiet", commit)
    return place


def is_known(commit, root):
    return subprocess.call(["git", "cat-file", "-e", commit], cwd=root, stderr=subprocess.DEVNULL) == 0


def git(root, *words):
    return subprocess.check_output(["git", *words], cwd=root, text=True).strip()
