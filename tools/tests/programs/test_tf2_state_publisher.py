# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The program tf2_state_publisher: a robot's transforms from real joint states."""

import itertools
from contextlib import contextmanager
from functools import partial
from math import inf, nan

import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from robot_of_all_joints import ARM, FIXED, NAMES, expected, random_states
from sensor_msgs.msg import JointState
from starting_programs import ended, running
from std_msgs.msg import String
from waiting import answered, until

from tf2_msgs.msg import TFMessage
from tf2_ros.numpy import to_matrix
from tf2_ros_tools.nodes.state_publisher import StatePublisher
from tf2_ros_tools.urdf import decoded, parse

NAME = "tf2_state_publisher"
S = 1_000_000_000
PROBES_NS = range(S // 20, 40 * S, S // 20)  # stamps, each a joint state that is due
EVEN_LATE = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OTHER = ARM.replace('name="arm"', 'name="other"').replace("camera", "lidar")


class Robot:
    """The other nodes of a robot: they send joint states, and receive what the program publishes."""

    def __init__(self, node, executor):
        self._executor = executor
        self._states = node.create_publisher(JointState, "/joint_states", 10)
        self.moving, self.static, self.descriptions = [], [], []
        self._probes_ns = iter(PROBES_NS)
        self._is_heard = False
        node.create_subscription(TFMessage, "/tf", self._receive, 100)
        node.create_subscription(TFMessage, "/tf_static", self.static.append, EVEN_LATE)
        node.create_subscription(String, "/robot_description", self.descriptions.append, EVEN_LATE)

    def _receive(self, message):
        if stamps(message) <= {*PROBES_NS}:
            self._is_heard = True
        else:
            self.moving.append(message)

    def _is_connected(self):
        """Whether the program's transforms arrive, which may begin after it receives joint states."""
        if not self._is_heard:
            self.send(next(self._probes_ns), ["lift"], [0.0])
            self._executor.spin_once(timeout_sec=0.1)
        return self._is_heard

    def send(self, ns, names, positions):
        state = JointState(name=list(names), position=[float(one) for one in positions])
        state.header.stamp.sec, state.header.stamp.nanosec = divmod(ns, S)
        self._states.publish(state)

    def moved(self, ns, names, positions):
        """Send a state until its transforms arrive, because joint states may be lost; get them by child."""

        def answer():
            self.send(ns, names, positions)
            self._executor.spin_once(timeout_sec=0.1)
            return [one for one in self.moving if stamps(one) == {ns}]

        until(self._is_connected)  # because the program publishes a stamp once
        return by_child(until(answer)[0])


def stamps(message):
    return {one.header.stamp.sec * S + one.header.stamp.nanosec for one in message.transforms}


def by_child(message):
    return {one.child_frame_id: (one.header.frame_id, to_matrix(one)) for one in message.transforms}


def same(found, wanted, prefix=""):
    assert found.keys() == {prefix + child for child in wanted}
    for child, (parent, matrix) in wanted.items():
        assert found[prefix + child][0] == prefix + parent
        np.testing.assert_allclose(found[prefix + child][1], matrix, atol=1e-12)


@pytest.fixture
def robot(node, executor):
    return Robot(node, executor)


@contextmanager
def publishing(folder, *arguments):
    """The program with the robot ARM, for a `with` statement; its log is a file."""
    path = folder / "arm.urdf"
    path.write_text(ARM)
    with open(folder / "log", "w") as log, running(NAME, str(path), *arguments, stderr=log):
        yield


def test_joint_states_become_transforms(robot, executor, tmp_path):
    with publishing(tmp_path):
        for i, state in enumerate(random_states(3)):
            same(robot.moved((100 + i) * S, NAMES, state), expected(*state))
        # Both are latched, so they arrive however late.
        same(by_child(until(lambda: robot.static, executor)[0]), FIXED)
        assert until(lambda: robot.descriptions, executor)[0].data == ARM
    log = (tmp_path / "log").read_text()
    assert ": Robot initialized: <tf2_ros_tools.urdf.Robot 'arm': 5 movable" in log


def test_a_joint_is_published_at_most_at_the_frequency(robot, tmp_path):
    with publishing(tmp_path, "--ros-args", "-p", "publish_frequency:=10.0"):
        robot.moved(100 * S, ["lift"], [0.1])
        for ns in (100 * S + S // 20, 100 * S + S // 10 - 1, 99 * S, 100 * S):
            robot.send(ns, ["lift"], [9.0])
        robot.moved(100 * S + S // 10, ["lift"], [0.2])
        robot.send(100 * S + S // 10 + 1, ["lift"], [9.0])
        robot.moved(100 * S + S // 10 + 2, ["lift", "roll"], [0.3, 0.1])  # due because of the other joint
    seen = [*dict.fromkeys(ns for one in robot.moving for ns in stamps(one))]
    assert seen == [100 * S, 100 * S + S // 10, 100 * S + S // 10 + 2]


def test_what_cannot_be_published_is_a_warning(robot, tmp_path):
    log = tmp_path / "log"
    with publishing(tmp_path):

        def warned(text, ns, positions):
            """Send a state until the program warns, because joint states may be lost."""

            def said():
                robot.send(ns, NAMES, positions)
                return text in log.read_text()

            until(said)

        shoulder = {"shoulder": expected(0.1, 0, 0)["shoulder"]}
        same(robot.moved(100 * S, ["lift"], [0.1]), shoulder)
        warned("joint states of lift, roll, extend: 3 names, but 1 positions", 102 * S, [1.0])
        warned("the stamp 0; to publish them, set the parameter ignore_timestamp", 0, [1.0, 1.0, 1.0])
        # Stamps that go back are followed.
        same(robot.moved(50 * S, ["lift"], [0.1]), shoulder)
        assert (
            log.read_text().count("The stamps of joint states went back; continuing from the earlier stamps")
            == 1
        )


LEFT_OUT = "has no transform while its position, or the position that it mimics, is NaN or infinite"


@pytest.mark.parametrize("options", [(), ("-p", "use_sim_time:=true", "-r", "joint_states:=/arm/states")])
def test_that_no_joint_states_arrive_is_a_warning_once(options, tmp_path):
    log, topic = tmp_path / "log", "/arm/states" if options else "/joint_states"
    with publishing(tmp_path, "--ros-args", *options):
        until(lambda: "No joint states" in log.read_text())
    text = f"No joint states have arrived on {topic}, which has 0 publishers: without them, movable joints ("
    assert f"{text}lift, roll, extend, grip, pinch) have no transforms" in log.read_text()


def test_a_robot_without_movable_joints_needs_no_joint_states(node, executor, capfd):
    joint = "<joint name='ab' type='fixed'><parent link='a'/><child link='b'/></joint>"
    publisher = StatePublisher(node, f"<robot name='a'><link name='a'/><link name='b'/>{joint}</robot>")
    until(publisher._silence.is_canceled, executor)
    assert "No joint states" not in capfd.readouterr().err


def test_a_joint_whose_position_is_not_finite_is_left_out_with_one_warning(robot, tmp_path):
    whole = expected(0.1, 0.2, 0.3)
    shoulder, wheel = ({child: whole[child]} for child in ("shoulder", "wheel"))
    with publishing(tmp_path):
        for i, (positions, wanted) in enumerate(
            [
                ([nan, 0.2, nan], wheel),
                ([0.1, inf, -inf], shoulder),
                ([0.1, 0.2, nan], shoulder | wheel),
                ([0.1, 0.2, 0.3], whole),
            ]
        ):
            same(robot.moved((100 + i) * S, NAMES, positions), wanted)
        # Nothing is sent where all are left out.
        robot.send(104 * S, NAMES, [nan, inf, -inf])
        same(robot.moved(105 * S, NAMES, [0.1, 0.2, 0.3]), whole)
    assert 104 * S not in {ns for one in robot.moving for ns in stamps(one)}
    log = (tmp_path / "log").read_text()
    assert log.count(LEFT_OUT) == 5
    for joint in (*NAMES, "grip", "pinch"):
        assert log.count(f"Joint {joint} {LEFT_OUT}\n") == 1


def test_names_that_are_not_joints_are_a_warning_once(robot, tmp_path):
    log, unknown = (
        tmp_path / "log",
        "In joint states, elbow, wrist are not joints of the URDF; missing there: ",
    )
    with publishing(tmp_path):
        stamps_ns = itertools.count(200 * S, S)

        def warned(said, *names):
            robot.send(next(stamps_ns), names, [1.0] * len(names))
            return said in log.read_text()

        until(partial(warned, f"{unknown}lift, roll, extend\n", "elbow", "wrist"))
        for _ in range(3):
            robot.send(next(stamps_ns), ["wrist", "mount", "drive", "fly"], [1.0, 2.0, 3.0, 4.0])
        # Also if others are.
        text = "In joint states, li-ft is not a joint of the URDF; missing there: lift\n"
        until(partial(warned, text, "li-ft", "roll", "extend"))
        shoulder = {"shoulder": expected(0.1, 0, 0)["shoulder"]}
        same(robot.moved(next(stamps_ns), ["lift", "wrist"], [0.1, 2.0]), shoulder)
    assert log.read_text().count("of the URDF") == 2


class TestDescription:
    """What the program takes for one, from a file or as the parameter."""

    @pytest.mark.parametrize(
        ("encoding", "declared"),
        [
            *(("utf-8", "encoding='ISO-8859-1'"), ("utf-8-sig", "")),
            *(("latin-1", ""), ("latin-1", "encoding='utf-8'")),
            ("iso-8859-15", "encoding = 'ISO-8859-15' standalone='yes'"),
            ("utf-16", 'encoding="UTF-16"'),
            ("utf-16", ""),
        ],
    )
    def test_is_in_utf_8_or_the_declared_encoding_or_latin_1(self, encoding, declared):
        name = "€" if encoding == "iso-8859-15" else "gâté"
        text = f"<?xml version='1.0' {declared}?><robot name='{name}'><link name='{name}'/></robot>"
        found = decoded(text.encode(encoding))
        assert found == text
        assert parse(found).root == parse(text.encode(encoding)).root == name

    @pytest.mark.parametrize(
        ("declared", "said"), [("x-no", "unknown encoding: x-no"), ("ASCII", "'ascii' codec ")]
    )
    def test_in_another_encoding_is_refused(self, declared, said, tmp_path):
        text = f"<?xml version='1.0' encoding='{declared}'?><robot name='é'/>"
        (tmp_path / "robot.urdf").write_bytes(text.encode("latin-1"))
        status, _, err = ended(NAME, "robot.urdf", cwd=tmp_path)
        assert (status, err.count("\n")) == (2, 1) and err.startswith(f"{NAME}: robot.urdf: {said}")

    @pytest.mark.parametrize(
        ("value", "said"),
        [
            ("/opt/robot.urdf", "'/opt/robot.urdf'; to read a file, name it without a parameter"),
            ("robot.urdf.xacro", "'robot.urdf.xacro'; to read a file, name it without a parameter"),
            ("package://arm/urdf/arm.xml", "'package://arm/urdf/arm.xml'; to read a file"),
            ("hello", "got 'hello' (see "),
        ],
    )
    def test_is_not_a_path(self, value, said):
        status, out, err = ended(NAME, "--ros-args", "-p", f"robot_description:={value}")
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert err.startswith(f"{NAME}: robot_description: expected the text of a URDF, got ") and said in err


class TestParameters:
    @pytest.fixture
    def change(self, node, executor, robot, tmp_path):
        """Sets a parameter of the program, which must exist by then; its answer."""
        with publishing(tmp_path, "--ros-args", "-p", "frame_prefix:=right/"):
            client = AsyncParameterClient(node, "robot_state_publisher")
            until(client.services_are_ready, executor)
            until(lambda: robot.descriptions, executor)

            def change(name, value):
                ask = partial(client.set_parameters, [Parameter(name, value=value)])
                return answered(ask, executor).results[0]

            yield change

    def test_another_description_is_another_robot(self, change, robot, executor):
        until(lambda: robot.static, executor)
        assert by_child(robot.static[-1]).keys() == {"right/camera", "right/cart"}
        assert change("robot_description", OTHER).successful
        until(lambda: robot.descriptions[-1].data == OTHER, executor)
        until(lambda: by_child(robot.static[-1]).keys() == {"right/lidar", "right/cart"}, executor)
        assert change("frame_prefix", "left/").successful
        until(lambda: by_child(robot.static[-1]).keys() == {"left/lidar", "left/cart"}, executor)
        wanted = {"shoulder": expected(0.1, 0, 0)["shoulder"]}
        same(robot.moved(100 * S, ["lift"], [0.1]), wanted, "left/")
        assert change("ignore_timestamp", True).successful
        for ns in (50 * S, 0):
            same(robot.moved(ns, ["lift"], [0.1]), wanted, "left/")

    def test_wrong_values_are_refused_with_the_reason(self, change):
        assert change("publish_frequency", 10.0).successful
        for name, value, reason in (
            ("publish_frequency", 1001.0, "expected a number from 0.0001 to 1000, got 1001"),
            ("robot_description", "<robot/>", "the robot has no links"),
        ):
            answer = change(name, value)
            assert (answer.successful, answer.reason) == (False, f"{name}: {reason}")
