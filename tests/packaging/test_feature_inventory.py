# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The inventory of features: every file belongs to a feature, and the page has the features."""

import subprocess

import pytest
from paths import ROOT

from release import feature_inventory as inventory


@pytest.fixture(scope="module")
def paths():
    if not (ROOT / ".git").exists():
        pytest.skip("this is not a clone")
    return subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines()


def test_every_file_belongs_to_a_feature(paths):
    _, strays = inventory.table(paths)
    assert strays == []


def test_every_pattern_is_of_a_file(paths):
    counted = [path for path in paths if inventory.counted(path)]
    patterns = [one for _, patterns in inventory.FEATURES.values() for one in patterns]
    assert [one for one in patterns if not inventory.fnmatch.filter(counted, one)] == []


def test_the_page_has_all_features():
    rows = [line.split("|") for line in inventory.PAGE.read_text().splitlines() if line.startswith("|")][2:]
    promises = {name.strip(): promise.strip() for _, name, promise, *_ in rows}
    expected = {name: promise for name, (promise, _) in inventory.FEATURES.items()}
    assert promises == expected | {"all": ""}
