# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The pages that list everything of a kind: the methods of a buffer, and the variables of the environment."""

import re

import pytest
from paths import ROOT
from project_sources import PACKAGES

from tf2_py import typing
from tf2_ros import Buffer, StaticTransformBroadcaster, TransformBroadcaster, TransformListener
from tf2_ros._nodes.qos import DYNAMIC_DEPTH, STATIC_DEPTH

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


def test_the_page_of_the_environment_shows_the_profiles_that_are_used(node):
    page = (ROOT / "docs" / "environment-and-qos.md").read_text(encoding="utf-8")
    row = re.compile(r"^\|[^|]*\| `(/tf\w*)` \| ([\w ]+) \| ([\w ]+) \| ([\d,]+)", re.MULTILINE)
    shown = [(*words, int(depth.replace(",", ""))) for *words, depth in row.findall(page)]
    listener = TransformListener(Buffer(), node)
    broadcasters = TransformBroadcaster(node), StaticTransformBroadcaster(node)
    used = []
    for one in (listener.tf_sub, listener.tf_static_sub, *(each.pub_tf for each in broadcasters)):
        qos = one.qos_profile
        words = (policy.name.lower().replace("_", " ") for policy in (qos.reliability, qos.durability))
        used.append((one.topic_name, *words, qos.depth))
    assert shown == used


def test_the_page_of_security_counts_the_messages_that_a_listener_queues():
    page = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    shown = f"{DYNAMIC_DEPTH} messages of `/tf` and {STATIC_DEPTH:,} of `/tf_static`"
    assert shown in " ".join(page.split())


@pytest.mark.parametrize("cls", [Buffer, TransformListener])
def test_the_cheat_sheet_lists_every_public_name(cls):
    page = (ROOT / "docs" / "cheat-sheet.md").read_text(encoding="utf-8")
    listed = {one for pair in re.findall(r"(\w+)\(|\.(\w+)", page) for one in pair}
    assert {name for name in dir(cls) if not name.startswith("_")} - listed == set()


def test_the_cheat_sheet_lists_every_argument_of_a_policy():
    page = (ROOT / "docs" / "cheat-sheet.md").read_text(encoding="utf-8")
    assert {*typing.LookupPolicy.__annotations__} <= {*re.findall(r"`(\w+)`", page)}
