"""Owns roll, pitch and yaw: turns about the fixed axes x, y and z, in this order, in radians."""

from math import asin, atan2, copysign, cos, pi, sin
from typing import Any

__all__ = ["quaternion_from_rpy", "rpy_from_matrix"]


def rpy_from_matrix(matrix: Any) -> tuple[float, float, float]:
    """
    Get the roll, pitch and yaw of a rotation.

    :param matrix: its upper left 3 x 3 numbers are the rotation.
    :return: in radians; the pitch is from -pi/2 to pi/2. At these two, where roll and yaw are turns about
        one axis, yaw is 0.
    """
    m = matrix
    if abs(m[2][0]) >= 1.0:
        return atan2(-m[1][2], m[1][1]), copysign(pi / 2, -m[2][0]), 0.0
    return atan2(m[2][1], m[2][2]), -asin(m[2][0]), atan2(m[1][0], m[0][0])


def quaternion_from_rpy(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Get the quaternion x y z w of these turns; it has length one."""
    # The product of the three turns, that about z on the left; J. Diebel, Representing Attitude, 2006.
    sr, cr = sin(roll / 2), cos(roll / 2)
    sp, cp = sin(pitch / 2), cos(pitch / 2)
    sy, cy = sin(yaw / 2), cos(yaw / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
