# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Show a transform as text, in one line."""

import math
from typing import Any

from tf2_py._internal import seconds, time_ns
from tf2_py.printable import printable
from tf2_ros._messages import numbers_of

GIMBAL_LOCK = 0.99999  # sine of the pitch from which on roll and yaw turn about one axis, as in tf2


def format_transform(transform: Any) -> str:
    """
    Write a transform in one line: from which frame to which, when, translation and rotation.

    :param transform: a ``TransformStamped``, ``Transform``, ``PoseStamped`` or ``Pose``, or an object with
        the fields of one.
    :return: the stamp in seconds, to the nanosecond; x y z in meters, to the millimeter; roll, pitch and yaw
        in degrees, to a tenth. These turn about the fixed axes x, y and z, one after the other. At a pitch of
        +-90 degrees, where only their sum or difference is known, the roll is 0.
    :raises TypeError: the type is wrong.
    :raises ValueError: the length of the rotation is zero or not finite.

    >>> from geometry_msgs.msg import TransformStamped
    >>> from tf2_ros import format_transform
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id = "base_link"
    >>> mount.transform.translation.x = 0.3
    >>> format_transform(mount)
    'base_link -> camera at 0.000000000: xyz [0.300 0.000 0.000] m, rpy [0.0 0.0 0.0] deg'
    """
    numbers = numbers_of(transform)
    length = math.hypot(*numbers[3:])
    if not 0 < length < math.inf:
        raise ValueError(f"the rotation must have a finite, non-zero length, got {tuple(numbers[3:])}")
    xyz = _fixed(numbers[:3], 3)
    rpy = _fixed(map(math.degrees, _roll_pitch_yaw(*(number / length for number in numbers[3:]))), 1)
    return f"{_where(transform)}xyz [{xyz}] m, rpy [{rpy}] deg"


def _where(transform: Any) -> str:
    header = getattr(transform, "header", None)
    if header is None:
        return ""
    child = getattr(transform, "child_frame_id", None)
    frames = printable(header.frame_id) + ("" if child is None else f" -> {printable(child)}")
    return f"{frames} at {seconds(time_ns(header.stamp, 'header.stamp'))}: "


def _fixed(numbers: Any, digits: int) -> str:
    # The sum turns a rounded -0.0 into 0.0.
    return " ".join(f"{round(number, digits) + 0.0:.{digits}f}" for number in numbers)


def _roll_pitch_yaw(x: float, y: float, z: float, w: float) -> tuple[float, float, float]:
    # For a unit quaternion; J. Diebel, Representing Attitude, 2006.
    sine = 2 * (w * y - x * z)
    if abs(sine) >= GIMBAL_LOCK:
        yaw = math.remainder(-math.copysign(2, sine) * math.atan2(x, w), math.tau)
        return 0.0, math.copysign(math.pi / 2, sine), yaw
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(sine),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )
