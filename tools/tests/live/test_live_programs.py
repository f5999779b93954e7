# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Programs that listen to a robot without ROS 2 on the machine: tf2_live, and `--live` of the others."""

import json
import os
import re

import pytest
from obeying_processes import Obeying
from ros_domains import claim_domain
from starting_programs import ROBOT, broadcasting, ended

from tf2_ros_tools import bag

pytest.importorskip("cyclonedds")

WITHOUT_ROS = os.environ | {"HEARS_WITHOUT_ROS": "1"}
NOBODYS = str(claim_domain())
NOWHERE = WITHOUT_ROS | {"ROS_DOMAIN_ID": NOBODYS}


def on_laptop(name, *arguments, hears=ROBOT, env=WITHOUT_ROS):
    return ended(name, *arguments, hears=hears, env=env)


@pytest.fixture(scope="module")
def robot():
    with broadcasting() as process:
        yield process


def test_tf2_live_shows_who_publishes_what(robot, tmp_path):
    saved = tmp_path / "saved.mcap"
    status, out, err = on_laptop("tf2_live", "dds://", "-o", str(saved))
    assert (status, err) == (0, "[INFO] Listening on /tf and /tf_static at dds:// for 5 s ...\n")
    lines = out.splitlines()
    assert re.fullmatch(r"/tf: \d+ messages, [\d.]+ a second; 0 malformed", lines[0])
    assert re.fullmatch(r"/tf_static: 1 message; 0 malformed", lines[1])
    assert re.fullmatch(r"clock: messages arrive at least [\d.e-]+ s after they were sent", lines[-1])
    text = "\n".join(lines[2:-1])
    assert "camera (static)" in text and re.search(r"odom \(\d+\.\d Hz\)", text)
    assert {"camera", "odom", "base_link"} <= {*bag.load(saved).frames()}


def test_tf2_live_says_why_nothing_arrives(robot):
    status, out, err = ended("tf2_live", "dds://", "-t", "0.1", env=NOWHERE)
    assert (status, err) == (1, "[INFO] Listening on /tf and /tf_static at dds:// for 0.1 s ...\n")
    assert (
        "nothing has been received on /tf or /tf_static in 0.1 s: no robot was found in domain "
        f"{NOBODYS} so far" in out
    )
    status, out, _ = ended("tf2_live", "dds://", "-t", "0.1", "--json", env=NOWHERE)
    told = json.loads(out)
    assert (status, told["topics"]["/tf"]["count"], told["streams"]) == (1, 0, [])
    assert f"domain {NOBODYS}" in told["silence"]


def test_tf2_check_says_why_nothing_arrives():
    status, out, _ = ended("tf2_check", "-t", "0.1", "--live", "dds://", env=NOWHERE)
    assert status == 1
    text = f"nothing: nothing has been received on .*: no robot was found in domain {NOBODYS} so far"
    assert re.match(text, out)
    assert out.count("\n") == 2, out


@pytest.mark.parametrize(
    ("line", "said"),
    [
        # A busy machine leaves gaps.
        ("tf2_check --ignore gap --live dds://", r"^no problems in "),
        ("view_frames --text --live dds://", r"(?m)^ +camera \(static\)"),
    ],
)
def test_others_listen_as_from_a_node(robot, line, said):
    name, *arguments = line.split()
    status, out, _ = on_laptop(name, *arguments)
    assert status == 0, out
    assert re.search(said, out), out


def test_tf2_echo_prints_the_transform(robot):
    status, out, _ = on_laptop("tf2_echo", "odom", "base_link", "--once", "--json", "--live", "dds://")
    told = json.loads(out)
    assert (status, told["header"]["frame_id"], told["child_frame_id"]) == (0, "odom", "base_link")
    assert told["transform"]["rotation"].keys() == {"x", "y", "z", "w"}


@pytest.fixture(scope="module")
def simulated():
    """The environment of the laptop, in the domain of a robot that publishes /clock."""
    environment = WITHOUT_ROS | {"ROS_DOMAIN_ID": str(claim_domain())}
    one = Obeying(environment=environment)
    one.do("from robot_with_rclpy import *; start(); clock()")
    yield environment
    one.end()


ENDED = "dds:// has ended (/clock is published, and simulated time is not supported)"


@pytest.mark.parametrize(
    "line",
    [
        "tf2_check -t 60",
        "view_frames -t 60 --text",
        "tf2_monitor --interval 60",
        "tf2_plot -t 60",
        "tf2_echo map base",
        "tf2_echo map base --wait 60",
    ],
)
def test_all_say_that_a_robot_with_simulated_time_has_ended_the_feed(simulated, line):
    name, *arguments = line.split()
    status, _, err = ended(name, *arguments, "--live", "dds://", env=simulated)
    assert (status, err.splitlines()[-1]) == (1, f"{name}: {ENDED}")


def test_tf2_live_says_that_a_robot_with_simulated_time_has_ended_the_feed(simulated):
    status, out, err = ended("tf2_live", "dds://", "-t", "60", env=simulated)
    assert (status, out.splitlines()[-1]) == (1, ENDED)
    assert err == "[INFO] Listening on /tf and /tf_static at dds:// for 60 s ...\n"
    status, out, _ = ended("tf2_live", "dds://", "-t", "60", "--json", env=simulated)
    told = json.loads(out)
    assert (status, told["silence"]) == (1, ENDED) and told["seconds"] < 60


@pytest.mark.parametrize(
    ("line", "status", "said"),
    [
        (
            "tf2_echo a b --live dds:// --qos-reliability reliable",
            2,
            "--live cannot be combined with --namespace, --qos-reliability or",
        ),
        ("tf2_check --live dds:// --namespace robot1", 2, "--live cannot be combined with --namespace or"),
        ("tf2_check --live robot:7447", 2, "expected an address such as zenoh://robot:7447"),
        ("tf2_live dds://?peer=robot", 2, "dds://?peer=robot: unknown option 'peer'"),
    ],
)
def test_what_is_wrong_is_said(line, status, said):
    name, *arguments = line.split()
    found, out, err = ended(name, *arguments)
    assert (found, out, err.count("\n")) == (status, "", 1)
    assert err.startswith(f"{name}: {said}"), err


@pytest.mark.parametrize(
    "more", ["--ros-args -p use_sim_time:=true", "--qos-reliability=reliable", "--namespace=robot1"]
)
def test_options_for_ros_are_refused_where_there_is_no_ros(more):
    status, out, err = on_laptop("tf2_echo", "a", "b", "--live=dds://", *more.split())
    assert (status, out) == (2, "")
    assert err.startswith(
        "tf2_echo: --live cannot be combined with --namespace, --qos-reliability or --ros-args"
    ), err
