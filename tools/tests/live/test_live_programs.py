# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Programs that listen to a robot without ROS 2 on the machine: their option `--live`."""

import json
import os
import re

import pytest
from obeying_processes import Obeying
from ros_domains import claim_domain
from starting_programs import ROBOT, broadcasting, ended, heard

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


LISTENING = "[INFO] Listening on /tf and /tf_static at dds:// for {} s..."


def test_tf2_check_shows_what_was_received_on_each_topic(robot):
    # A busy machine leaves gaps.
    status, out, err = on_laptop("tf2_check", "--ignore", "gap", "--live", "dds://")
    lines = [
        LISTENING.format(5),
        r"\[INFO\] /tf: \d+ messages, [\d.]+ a second; 0 malformed",
        r"\[INFO\] /tf_static: 1 message; 0 malformed",
        r"\[INFO\] messages arrive at least [\d.e-]+ s after they were sent",
    ]
    assert status == 0 and out.startswith("no problems in "), out
    assert re.fullmatch("\n".join([re.escape(lines[0]), *lines[1:], ""]), err), err


def test_tf2_check_says_why_nothing_arrives():
    status, out, err = ended("tf2_check", "-t", "0.1", "--live", "dds://", env=NOWHERE)
    assert status == 1
    text = (
        r"nothing has been received on /tf or /tf_static in [\d.]+ s: no robot was found in domain "
        f"{NOBODYS}( so far)?"  # not on a busy machine
    )
    assert re.match(f"nothing: {text}", out)
    assert out.count("\n") == 2, out
    silent = ["[INFO] /tf: 0 messages; 0 malformed", "[INFO] /tf_static: 0 messages; 0 malformed"]
    assert err.splitlines() == [LISTENING.format(0.1), *silent]
    status, out, _ = ended("tf2_check", "-t", "0.1", "--json", "--live", "dds://", env=NOWHERE)
    told = json.loads(out)
    assert (status, told["topics"]["/tf"]["count"], told["streams"]) == (1, 0, [])
    assert (told["publishers"], told["clock_offset"]) == ([], None)
    assert re.match(text, told["silence"])


def test_tf2_check_names_who_is_silent_and_says_why_a_topic_is():
    environment = WITHOUT_ROS | {"ROS_DOMAIN_ID": str(claim_domain())}
    one = Obeying("robot_with_rclpy", environment=environment)
    one.do(
        "from robot_with_rclpy import *; start(); latched('still', ('map', 'base')); "
        "publisher('idle', '/tf_static')"
    )
    silent = "any(one.node == '/idle' for one in feed.publishers())"
    hears = f"{heard('base')} and {silent}"
    _, out, err = on_laptop("tf2_check", "--live", "dds://", hears=hears, env=environment)
    one.end()
    assert out == "no problems in 2 frames (1 message, 5 s)\n"
    why = "/tf_static is received (1 message), but nothing on /tf in 5 s: no node publishes /tf in domain"
    assert err.splitlines()[3] == "[INFO] /idle: nothing has arrived"
    assert err.splitlines()[-1].startswith(f"[INFO] {why}"), err


def test_view_frames_draws_the_tree(robot):
    status, out, _ = on_laptop("view_frames", "--text", "--live", "dds://")
    assert status == 0, out
    assert re.search(r"(?m)^ +camera \(static\)", out), out


def test_tf2_echo_prints_the_transform(robot):
    status, out, _ = on_laptop("tf2_echo", "odom", "base_link", "--once", "--json", "--live", "dds://")
    told = json.loads(out)
    assert (status, told["header"]["frame_id"], told["child_frame_id"]) == (0, "odom", "base_link")
    assert told["transform"]["rotation"].keys() == {"x", "y", "z", "w"}


@pytest.fixture(scope="module")
def simulated():
    """The environment of the laptop, in the domain of a robot that publishes /clock."""
    environment = WITHOUT_ROS | {"ROS_DOMAIN_ID": str(claim_domain())}
    one = Obeying("robot_with_rclpy", environment=environment)
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
        ("tf2_check --live dds://?peer=robot", 2, "dds://?peer=robot: unknown option 'peer'"),
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
