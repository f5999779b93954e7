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
    "A_MESSAGE",
    "Header",
    "Point",
    "Pose",
    "PoseStamped",
    "Quaternion",
    "Time",
    "Transform",
    "TransformStamped",
    "Vector3",
    "numbers_of",
    "time_msg",
]

A_MESSAGE = "a TransformStamped, Transform, PoseStamped or Pose"


def time_msg(time: Any, argument: str) -> Time:
    """
    The time message of a time; it raises as ``tf2_py._internal.stamp_parts``.

    :param argument: its name in errors.
    """
    sec, nanosec = stamp_parts(time, argument)
    return Time(sec=sec, nanosec=nanosec)


def numbers_of(msg: Any) -> tuple[float, ...]:
    """
    The translation and the rotation, x y z x y z w, of a transform or a pose.

    :raises TypeError: it is something else.
    """
    inner = getattr(msg, "transform", getattr(msg, "pose", msg))
    expected = f"expected {A_MESSAGE}, got {type(msg).__name__}"
    try:
        if hasattr(inner, "translation"):
            v, q = inner.translation, inner.rotation
        elif hasattr(inner, "position"):
            v, q = inner.position, inner.orientation
        else:
            raise TypeError(expected)
        return (v.x, v.y, v.z, q.x, q.y, q.z, q.w)
    except AttributeError as missing:
        raise TypeError(f"{expected}: {missing}") from None
