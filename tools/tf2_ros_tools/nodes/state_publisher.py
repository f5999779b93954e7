# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Publish the transforms of a robot's joints from a node: those of its joint states, and the fixed ones."""

# First, because its errors say in one line what is missing, or that another tf2_ros is imported.
from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

# isort: split

from collections.abc import Sequence
from typing import Any

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from tf2_py.printable import printable
from tf2_ros.serialization import serialize_arrays
from tf2_ros_tools.common.output import counted, first_names
from tf2_ros_tools.common.program import UsageError
from tf2_ros_tools.urdf import fixed, parse, unmatched

S = 1_000_000_000
LOWEST_HZ, HIGHEST_HZ = 0.0001, 1000.0
JUMP_NS = 1_000_000_000  # stamps go back further than this when a recording begins again
MOST_JUDGED = 10_000  # names
LONGEST_TEXT = 80  # of a description that is none, in an error
SILENCE_S = 5.0  # after which a warning says that no joint states arrive
SELDOM = {"throttle_duration_sec": 5.0}  # warnings about messages


def _check_text(description: str) -> None:
    """Raise a ValueError unless this may be XML."""
    begin = description.lstrip("\ufeff \t\r\n")
    if not begin.startswith("<"):
        is_path = "/" in begin or begin.lower().endswith((".urdf", ".xacro", ".xml"))
        advice = "; to read a file, name it without a parameter: tf2_state_publisher FILE" if is_path else ""
        raise ValueError(f"expected the text of a URDF, got {begin[:LONGEST_TEXT]!r}{advice}")


class StatePublisher:
    """
    Publishes the transforms of a robot.

    :param node: its executor calls this object.
    :param description: the default of ``robot_description``.
    :raises UsageError: a parameter has a wrong value.
    """

    def __init__(self, node: Node, description: str) -> None:
        self._node = node
        self._log = node.get_logger()
        self._published_ns: dict[str, int] = {}  # the last stamp of each joint
        self._called_ns = 0
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._descriptions = node.create_publisher(String, "robot_description", latched)
        # They choose the quality of service, but a state of many joints is faster as one serialized message.
        self._transforms = TransformBroadcaster(node).pub_tf
        self._static = StaticTransformBroadcaster(node).pub_tf
        for name, default in (
            ("robot_description", description),
            ("publish_frequency", 20.0),
            ("frame_prefix", ""),
            ("ignore_timestamp", False),
        ):
            node.declare_parameter(name, default)
        # First, because the executor may set parameters at any time, and only checked ones may follow.
        node.add_on_set_parameters_callback(self._accept)
        node.add_post_set_parameters_callback(self._apply)
        accepted = self._accept(node.get_parameters(["robot_description", "publish_frequency"]))
        if not accepted.successful:
            raise UsageError(accepted.reason)
        self._describe()
        states = node.create_subscription(
            JointState,
            "joint_states",
            self._receive,
            qos_profile_sensor_data,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._topic = states.topic_name
        # Simulated time may stand still until the simulation runs.
        self._silence = node.create_timer(
            SILENCE_S, self._warn_of_silence, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def _value(self, name: str) -> Any:
        return self._node.get_parameter(name).value

    def _accept(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        reason = ""
        for one in parameters:
            value: Any = one.value
            if one.name == "robot_description" and not value:
                reason = "robot_description must not be empty: set this parameter, or pass the file of a URDF"
            elif one.name == "robot_description":
                try:
                    _check_text(value)
                    parse(value)
                except ValueError as refusal:
                    reason = f"robot_description: {refusal}"
            elif one.name == "publish_frequency" and not LOWEST_HZ <= value <= HIGHEST_HZ:
                reason = (
                    f"publish_frequency: expected a number from {LOWEST_HZ} to {HIGHEST_HZ:g}, got {value:g}"
                )
        return SetParametersResult(successful=not reason, reason=reason)

    def _apply(self, parameters: list[Parameter]) -> None:
        if any(one.name in ("robot_description", "frame_prefix") for one in parameters):
            self._describe()

    def _describe(self) -> None:
        """Read the description, and publish it and the fixed joints."""
        description = self._value("robot_description")
        self._robot = parse(description, self._value("frame_prefix"))
        self._judged: set[str] = set()  # names in joint states
        self._left_out: set[str] = set()  # the joints of which a warning has said so
        self._descriptions.publish(String(data=description))
        self._static.publish(fixed(self._robot, (), self._node.get_clock().now().nanoseconds))
        self._log.info(f"Robot initialized: {self._robot!r}")
        for problem in self._robot.warnings:
            self._log.warning(problem)

    def _warn_of_silence(self) -> None:
        """Say once why movable joints have no transforms."""
        self._silence.cancel()
        movable = [one.name for one in self._robot.joints if one.type != "fixed"]
        if movable:
            publishers = counted(self._node.count_publishers(self._topic), "publisher")
            self._log.warning(
                f"No joint states have arrived on {self._topic}, which has {publishers}: without them,"
                f" movable joints ({first_names(movable)}) have no transforms"
            )

    def _receive(self, state: JointState) -> None:
        self._silence.cancel()
        names, positions = list(state.name), state.position
        if not names or len(positions) != len(names):
            found = f"{len(names)} names, but {len(positions)} positions"
            self._log.warning(f"Ignoring joint states of {first_names(names)}: {found}", **SELDOM)
            return
        stamp_ns = state.header.stamp.sec * S + state.header.stamp.nanosec
        if not self._is_due(names, stamp_ns):
            return
        self._warn_of_unknown(names)
        joints, translations, rotations = self._robot.transforms(names, positions)
        if not joints:
            return
        # Every listener refuses other transforms, and those in C++ log each of them.
        transforms = np.hstack((translations, rotations))
        finite = np.isfinite(transforms).all(axis=1)
        self._warn_of_left_out([joints[k].name for k in np.flatnonzero(~finite)])
        frames = [(joints[k].parent, joints[k].child) for k in np.flatnonzero(finite)]
        if frames:
            stamps_ns = [stamp_ns] * len(frames)
            self._transforms.publish(serialize_arrays(frames, stamps_ns, transforms[finite]))

    def _warn_of_unknown(self, names: Sequence[str]) -> None:
        """Say once of each name that it is not a joint of the robot."""
        # A publisher that invents names must not fill the memory.
        if len(self._judged) < MOST_JUDGED and not self._judged.issuperset(names):
            if text := unmatched(self._robot, names, self._judged):
                self._log.warning(f"In joint states, {text}")
            self._judged.update(names)

    def _warn_of_left_out(self, names: Sequence[str]) -> None:
        """Say once for each joint that it is left out."""
        for name in names:
            if name not in self._left_out:
                self._left_out.add(name)
                text = (
                    "has no transform while its position, or the position that it mimics, is NaN or infinite"
                )
                self._log.warning(printable(f"Joint {name} {text}"))

    def _is_due(self, names: Sequence[str], stamp_ns: int) -> bool:
        now_ns = self._node.get_clock().now().nanoseconds
        if now_ns < self._called_ns:
            self._log.warning("Moved backwards in time, re-publishing joint transforms!")
            self._published_ns.clear()
        self._called_ns = now_ns
        oldest_ns = min(self._published_ns.get(name, 0) for name in names)
        is_due = self._value("ignore_timestamp")
        is_due = is_due or stamp_ns >= oldest_ns + int(S / self._value("publish_frequency"))
        if not is_due and 0 < stamp_ns < oldest_ns - JUMP_NS:
            self._log.warning(
                "The stamps of joint states went back; continuing from the earlier stamps", **SELDOM
            )
            is_due = True
        if is_due:
            self._published_ns.update(dict.fromkeys(names, stamp_ns))
        elif stamp_ns == 0:
            self._log.warning(
                "Ignoring joint states with the stamp 0; to publish them, set the parameter ignore_timestamp",
                **SELDOM,
            )
        return bool(is_due)
