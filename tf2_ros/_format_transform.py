# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Show a transform as text, in one line."""

from math import degrees
from typing import Any

from tf2_py._internal import rpy_of, seconds, time_ns
from tf2_py.printable import printable
from tf2_ros._messages import numbers_of


def format_transform(transform: Any) -> str:
    """
    Write a transform in one line: from which frame to which, when, translation and rotation.

    :param transform: a ``TransformStamped``, ``Transform``, ``PoseStamped`` or ``Pose``, or an object with
        the fields of one.
    :return: the stamp in seconds, to the nanosecond; x y z in meters, to the millimeter; roll, pitch and yaw
        in degrees, to a tenth. These turn about the fixed axes x, y and z, one after the other. At a pitch of
        +-90 degrees, where only their sum or difference is known, the yaw is 0, as in tf2's ``getRPY``.
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
    xyz = _fixed(numbers[:3], 3)
    rpy = _fixed(map(degrees, rpy_of(*numbers[3:])), 1)
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
