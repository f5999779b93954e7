# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated time that a test sets."""

from rclpy.clock import ClockType
from rclpy.parameter import Parameter
from rclpy.time import Time


def simulate(node, *, ns=None, seconds=0.0):
    """Switch simulated time on for a node, and set it."""
    if not node.get_clock().ros_time_is_active:
        node.set_parameters([Parameter("use_sim_time", value=True)])
    ns = round(seconds * 1_000_000_000) if ns is None else ns
    node.get_clock().set_ros_time_override(Time(nanoseconds=ns, clock_type=ClockType.ROS_TIME))
