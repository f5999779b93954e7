# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Convert rotations to and from roll, pitch and yaw."""

from math import cos, isfinite, sin

from geometry_msgs.msg import Quaternion

from tf2_py._internal import MalformedObjectError, rpy_of


def quaternion_from_rpy(roll: float, pitch: float, yaw: float) -> Quaternion:
    """
    Get the rotation by these angles, as ``tf2::Quaternion::setRPY`` does.

    :param roll: about the x axis, in radians; it comes first.
    :param pitch: about the y axis, in radians. The axes are fixed: they do not turn with the body.
    :param yaw: about the z axis, in radians; it comes last.
    :return: a ``geometry_msgs/Quaternion`` of length 1.
    :raises TypeError: an angle is not a number.
    :raises ValueError: an angle is NaN or infinite.

    >>> from math import pi
    >>> from tf2_geometry_msgs import quaternion_from_rpy
    >>> quarter_turn = quaternion_from_rpy(0.0, 0.0, pi / 2)
    >>> round(quarter_turn.z, 4), round(quarter_turn.w, 4)
    (0.7071, 0.7071)
    """
    if not (isfinite(roll) and isfinite(pitch) and isfinite(yaw)):
        raise ValueError(f"roll, pitch and yaw must be finite, got {(roll, pitch, yaw)}")
    # The product of the three turns, that about z on the left; J. Diebel, Representing Attitude, 2006.
    sr, cr = sin(roll / 2), cos(roll / 2)
    sp, cp = sin(pitch / 2), cos(pitch / 2)
    sy, cy = sin(yaw / 2), cos(yaw / 2)
    return Quaternion(
        x=sr * cp * cy - cr * sp * sy,
        y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy,
        w=cr * cp * cy + sr * sp * sy,
    )


def rpy_from_quaternion(q: Quaternion) -> tuple[float, float, float]:
    """
    Get the roll, pitch and yaw of a rotation, as ``tf2::Matrix3x3::getRPY`` does.

    :param q: a ``geometry_msgs/Quaternion`` or an object with its fields, of any length but 0.
    :return: turns about the fixed axes x, y and z, one after the other, in radians. Roll and yaw are from -pi
        to pi, the pitch from -pi/2 to pi/2. At these two limits, where roll and yaw turn about the same axis
        (gimbal lock), the yaw is 0.
    :raises TypeError: ``q`` does not have the fields of a quaternion.
    :raises ValueError: the length is 0, NaN or infinite.

    >>> from tf2_geometry_msgs import quaternion_from_rpy, rpy_from_quaternion
    >>> [round(angle, 6) for angle in rpy_from_quaternion(quaternion_from_rpy(0.1, 0.2, 0.3))]
    [0.1, 0.2, 0.3]
    """
    try:
        return rpy_of(q.x, q.y, q.z, q.w)
    except (AttributeError, TypeError) as wrong:
        got = type(q).__name__
        raise MalformedObjectError(f"expected a geometry_msgs/Quaternion, got {got}: {wrong}") from None
