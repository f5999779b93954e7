# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The pages that list everything of a kind: the methods of a buffer, and the variables of the environment."""

import re

import pytest
from paths import ROOT
from project_sources import PACKAGES

from tf2_py import typing
from tf2_ros import Buffer, TransformListener

pytestmark = pytest.mark.ours

# `os.environ.get("NAME"`, `environ["NAME"`, `"NAME" in os.environ`.
READ = re.compile(r"""environ(?:\.get\(|\[)["'](\w+)|["'](\w+)["'] (?:not )?in (?:os\.)?environ\b""")
# Some are read by a name that is put together or kept in a constant.
OURS = re.compile(r"\bTF2_ROS_CYTHON\w*\b")


def variables_read():
    """The variables that the installed packages and the tools read."""
    found = set()
    for folder in (*PACKAGES, "tools/tf2_ros_tools"):
        for path in (ROOT / folder).rglob("*.py*"):
            if path.suffix in (".py", ".pyx"):
                text = path.read_text(encoding="utf-8")
                found |= {one for pair in READ.findall(text) for one in pair if one} | {*OURS.findall(text)}
    return found - {"TF2_ROS_CYTHON_"}


def test_the_page_of_the_environment_lists_the_variables_that_are_read():
    page = (ROOT / "docs" / "environment-and-qos.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `([A-Z0-9_]+)`", page, re.MULTILINE)) == variables_read()


@pytest.mark.parametrize("cls", [Buffer, TransformListener])
def test_the_cheat_sheet_lists_every_public_name(cls):
    page = (ROOT / "docs" / "cheat-sheet.md").read_text(encoding="utf-8")
    listed = {one for pair in re.findall(r"(\w+)\(|\.(\w+)", page) for one in pair}
    assert {name for name in dir(cls) if not name.startswith("_")} - listed == set()


def test_the_cheat_sheet_lists_every_argument_of_a_policy():
    page = (ROOT / "docs" / "cheat-sheet.md").read_text(encoding="utf-8")
    assert {*typing.LookupPolicy.__annotations__} <= {*re.findall(r"`(\w+)`", page)}
