# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The program tf2_echo, against real broadcasters."""

import json
import math
import re

import pytest
from calls_in_threads import repeated
from rclpy.qos import QoSProfile, ReliabilityPolicy
from scipy.spatial.transform import Rotation
from starting_programs import ended, running
from times_and_transforms import S, transform
from waiting import DEADLINE_S, until, until_told

from tf2_msgs.msg import TFMessage

WAIT = ["--wait", str(DEADLINE_S)]


@pytest.fixture
def best_effort(new_node):
    """Publishes the transform from robot to map on /tf, as best effort."""
    profile = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    node = new_node("best_effort")
    publisher = node.create_publisher(TFMessage, "/tf", profile)
    with repeated(lambda: publisher.publish(TFMessage(transforms=[transform("map", "robot", 1)]))):
        yield publisher


class TestQualityOfService:
    def test_a_best_effort_publisher_is_received_if_that_is_asked_for(self, best_effort):
        options = ["--qos-reliability", "best_effort"]
        assert ended("tf2_echo", "map", "robot", "--once", *WAIT, *options)[0] == 0

    def test_otherwise_it_is_not_and_a_warning_says_so(self, best_effort, peer):
        said = "on topic '/tf', offering incompatible QoS"
        with running("tf2_echo", "map", "robot", "--once", *WAIT) as echo:
            until(lambda: said in echo.stderr.readline())
            peer().send(("map", "robot", 2 * S, 1.0))  # which is the first one that it receives
            out, _ = echo.communicate(timeout=DEADLINE_S)
        assert (echo.returncode, out.partition("\n")[0]) == (0, "At time 2.000000000")


class TestText:
    def test_a_rotation_is_printed_in_all_forms(self):
        turn = ["--roll", "0.1", "--pitch", "-.2", "--yaw", "2.5"]
        with running("static_transform_publisher", "--frame-id", "a", "--child-frame-id", "b", *turn):
            status, out, _ = ended("tf2_echo", "a", "b", "--once", "20", *WAIT)
        assert status == 0
        q = Rotation.from_euler("xyz", [0.1, -0.2, 2.5])
        assert f"- Rotation: in Quaternion (xyzw) {listed(q.as_quat())}\n" in out
        assert f"- Rotation: in RPY (radian) {listed([0.1, -0.2, 2.5])}\n" in out
        assert f"- Rotation: in RPY (degree) {listed(map(math.degrees, [0.1, -0.2, 2.5]))}\n" in out
        for row in q.as_matrix():
            assert "".join(f" {number:6.3f}" for number in row) + "  0.000\n" in out

    def test_a_failure_after_a_success_is_printed_with_the_frames(self, peer):
        with (
            running("tf2_echo", "map", "robot", "20") as echo,
            running("tf2_echo", "map", "robot", "--json") as other,
        ):
            talker = peer()
            talker.matched(2)
            talker.send(("map", "robot", S, 1.0))
            assert echo.stdout.readline().startswith("At time ")
            assert "error" not in json.loads(other.stdout.readline())
            talker.send(("moon", "robot", 2 * S, 1.0))  # another parent: no connection any more
            until(lambda: echo.stdout.readline().startswith("Failure at "))
            failure = until(lambda: (line := json.loads(other.stdout.readline())).get("error") and line)
            assert failure["error"]["type"] in ("ConnectivityException", "LookupException")
            assert "map" in failure["error"]["text"]
            assert (failure["header"]["frame_id"], failure["child_frame_id"]) == ("map", "robot")
            assert re.match("Exception thrown:.*(map|robot)", echo.stdout.readline())
            assert echo.stdout.readline() == "The current list of frames is:\n"
            assert echo.stdout.readline() == "Frame robot exists with parent moon.\n"


def listed(numbers):
    return "[" + ", ".join(f"{number:.3f}" for number in numbers) + "]"


def test_the_known_frames_are_told_and_cannot_write_a_line_of_their_own(peer):
    with running("tf2_echo", "map", "robot") as echo:
        talker = peer()
        talker.send(("map", "x\x1b[2J\n[INFO]", S, 1.0))
        until(lambda: echo.stderr.readline() == "Known frames: map, x\\x1b[2J\\n[INFO]\n")
        talker.send(*((f"f{i:03d}", f"f{i + 1:03d}", S, 1.0) for i in range(999)))
        names = ", ".join(f"f{i:03d}" for i in range(5))
        until(lambda: echo.stderr.readline() == f"Known frames: {names} and 997 more\n")


def test_when_simulated_time_jumps_back_the_old_transforms_are_forgotten(peer):
    with running("tf2_echo", "map", "robot", "20", "--ros-args", "-p", "use_sim_time:=true") as echo:
        talker = peer()
        talker.set_clock(100)
        talker.send(("map", "robot", 100 * S, 1.0))
        assert echo.stdout.readline() == "At time 100.000000000\n"

        def forgotten():
            talker.set_clock(100)
            talker.set_clock(5)
            return echo.stdout.readline().startswith("Failure at 5.000")

        until(forgotten)


def test_who_asks_the_robot_for_its_frames_is_not_answered_by_it(node):
    with running("tf2_echo", "map", "robot"):
        until(lambda: node.count_subscribers("/tf"))
        until_told(lambda: "tf2_echo" in node.get_node_names())
        # It exists for a moment, until the program has removed it.
        until(lambda: "/tf2_frames" not in [name for name, _ in node.get_service_names_and_types()])
