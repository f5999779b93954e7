# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Provide the message classes of ROS, or simple classes with the same fields, and make times of them."""

from typing import TYPE_CHECKING, Any

from tf2_py._internal import message_classes, stamp_parts

if TYPE_CHECKING:  # what type checkers know of them
    from builtin_interfaces.msg import Time as Time
    from geometry_msgs.msg import Pose as Pose
    from geometry_msgs.msg import PoseStamped as PoseStamped
    from geometry_msgs.msg import Quaternion as Quaternion
    from geometry_msgs.msg import Transform as Transform
    from geometry_msgs.msg import TransformStamped as TransformStamped
    from std_msgs.msg import Header as Header
else:
    globals().update({name: getattr(message_classes, name) for name in message_classes.__all__})


def time_msg(time: Any, argument: str) -> Time:
    """
    The time message of a time; it raises as ``tf2_py._internal.stamp_parts``.

    :param argument: its name in errors.
    """
    sec, nanosec = stamp_parts(time, argument)
    return Time(sec=sec, nanosec=nanosec)
