# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The arguments of `connect`, and libraries that are missing."""

import sys
from importlib.util import find_spec

import pytest

from tf2_ros_tools.live import connect

NEEDS_DDS = pytest.mark.skipif(find_spec("cyclonedds") is None, reason="cyclonedds is not installed")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"where": "robot"}, "expected an address such as zenoh://robot:7447"),
        pytest.param(
            {"where": "dds://robot"}, "give the robot's address as dds://.peers=192.168.0.7", marks=NEEDS_DDS
        ),
        pytest.param({"where": "dds://5"}, "^dds://5: .*, and its domain in ROS_DOMAIN_ID$", marks=NEEDS_DDS),
        pytest.param(
            {"where": "dds://?peer=x"}, "unknown option 'peer'; dds:// accepts peers", marks=NEEDS_DDS
        ),
        ({"where": "dds://robot:seven"}, "expected an address such as"),
        ({"where": "dds://", "domain": -1}, "domain: expected a number from 0 to 232, got -1"),
        ({"where": "dds://", "domain": "1"}, "domain: expected a number from 0 to 232, got '1'"),
        ({"where": "dds://", "domain": True}, "domain: expected a number from 0 to 232, got True"),
        ({"where": "ws://robot:0"}, "got 'ws://robot:0': a port is a number from 1 to 65535$"),
        ({"where": "zenoh://robot:0"}, "got 'zenoh://robot:0': a port is a number from 1 to 65535$"),
        ({"where": "zenoh://robot:70000"}, "got 'zenoh://robot:70000': Port out of range"),
        (
            {"where": "ws://robot/bridge"},
            "'ws://robot/bridge': only a host, a port and options are understood",
        ),
        ({"where": "ws://me:pass@robot"}, "only a host, a port and options are understood"),
        ({"where": "dds://?peers=robot#1"}, "only a host, a port and options are understood"),
        ({"where": "dds://?peers=robot&peers=other"}, "an option is given twice"),
        ({"where": "dds://", "topic": ""}, "expected the name of a topic, such as /tf, got ''"),
        (
            {"where": "dds://", "topic": "tf_static"},
            "topic and static_topic must differ, but both are '/tf_static'",
        ),
    ],
)
def test_arguments_of_connect(arguments, text):
    with pytest.raises(ValueError, match=text):
        connect(**arguments)


@pytest.mark.parametrize("where", [None, b"dds://", 5])
def test_an_address_is_a_str(where):
    with pytest.raises(TypeError, match="^where: expected a str, such as zenoh://robot:7447, "):
        connect(where)


@pytest.mark.parametrize("domain", ["seven", "233"])
def test_a_domain_of_the_environment_must_be_a_number(monkeypatch, domain):
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    with pytest.raises(ValueError, match=f"^ROS_DOMAIN_ID: expected a number from 0 to 232, got '{domain}'$"):
        connect("dds://")


LACKS_DDS = "; PyPI lacks it for Python 3.14 and for Linux on ARM: use ws:// and foxglove_bridge there"


@pytest.mark.parametrize(
    ("where", "library", "extra", "advice"),
    [
        ("dds://", "cyclonedds", "dds", LACKS_DDS),
        ("zenoh://127.0.0.1", "zenoh", "zenoh", ""),
        ("zenoh://127.0.0.1", "xxhash", "zenoh", ""),
        ("ws://127.0.0.1", "websockets", "foxglove", ""),
    ],
)
def test_a_library_is_missing(where, library, extra, advice, monkeypatch):
    if library == "xxhash":
        pytest.importorskip("zenoh")
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ModuleNotFoundError) as raised:
        connect(where)
    assert str(raised.value) == f"{library} is not installed: pip install 'tf2-ros-tools[{extra}]'{advice}"


@pytest.mark.parametrize(
    ("where", "library", "text"),
    [
        ("zenoh://", "zenoh", "expected the host of a router, as in zenoh://robot:7447"),
        ("zenoh://robot?peers=1", "zenoh", "unknown option 'peers'; zenoh:// accepts none"),
        ("ws://", "websockets", "expected the host of a bridge, as in ws://robot:8765"),
        ("ws://robot?peers=1", "websockets", "unknown option 'peers'; ws:// accepts none"),
    ],
)
def test_an_address_lacks_a_host_or_has_an_unknown_option(where, library, text):
    pytest.importorskip(library)
    with pytest.raises(ValueError, match=f"{text}$"):
        connect(where)
