"""Provide the message classes of ROS, or without ROS, simple classes with the same fields."""

from typing import TYPE_CHECKING, Any

from tf2_py._internal import message_classes, stamp_parts

if TYPE_CHECKING:  # what type checkers know of them
    from builtin_interfaces.msg import Time
    from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Transform, TransformStamped, Vector3
    from std_msgs.msg import Header
else:
    globals().update({name: getattr(message_classes, name) for name in message_classes.__all__})

__all__ = [
    "Header",
    "Point",
    "Pose",
    "PoseStamped",
    "Quaternion",
    "Time",
    "Transform",
    "TransformStamped",
    "Vector3",
    "time_msg",
]


def time_msg(time: Any, argument: str) -> Time:
    """
    The time message of a time; it raises as ``tf2_py._internal.stamp_parts``.

    :param argument: its name in errors.
    """
    sec, nanosec = stamp_parts(time, argument)
    return Time(sec=sec, nanosec=nanosec)
