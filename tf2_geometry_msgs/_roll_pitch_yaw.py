# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Convert rotations to and from roll, pitch and yaw."""

from math import atan2, copysign, cos, hypot, inf, isfinite, pi, remainder, sin, tau

from geometry_msgs.msg import Quaternion

from tf2_py._internal import MalformedObjectError

# tf2's getRPY is locked where the sine of the pitch rounds to 1, about this far from 90 degrees, in radians.
GIMBAL_LOCK = 1e-8


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
        x, y, z, w = q.x, q.y, q.z, q.w
        length = hypot(x, y, z, w)
    except (AttributeError, TypeError) as wrong:
        got = type(q).__name__
        raise MalformedObjectError(f"expected a geometry_msgs/Quaternion, got {got}: {wrong}") from None
    if not 0 < length < inf:
        raise ValueError(f"the rotation must have a finite, non-zero length, got {(x, y, z, w)}")
    # The products of quaternion_from_rpy, added: w + y = (cos + sin)(pitch / 2) cos((roll - yaw) / 2), and so
    # on. Unlike an arc sine, they lose no digits near gimbal lock, and any length of q cancels.
    up, down = hypot(w + y, x - z), hypot(w - y, x + z)  # sqrt(2) cos and sin of (pi/2 - pitch) / 2
    half_difference, half_sum = atan2(x - z, w + y), atan2(x + z, w - y)
    if 2 * min(up, down) < GIMBAL_LOCK * max(up, down):
        roll = 2 * (half_difference if up > down else half_sum)
        return remainder(roll, tau), copysign(pi / 2, up - down), 0.0
    roll, yaw = half_sum + half_difference, half_sum - half_difference
    return remainder(roll, tau), 2 * atan2(up, down) - pi / 2, remainder(yaw, tau)
