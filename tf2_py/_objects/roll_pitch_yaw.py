# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Convert a quaternion to roll, pitch and yaw."""

from math import atan2, copysign, hypot, inf, pi, remainder, tau

# tf2's getRPY is locked where the sine of the pitch rounds to 1, about this far from 90 degrees, in radians.
GIMBAL_LOCK = 1e-8


def rpy_of(x: float, y: float, z: float, w: float) -> tuple[float, float, float]:
    """
    Get the turns about the fixed axes x, y and z, in this order, in radians, as tf2's ``getRPY`` does.

    In gimbal lock the yaw is 0.

    :raises ValueError: the length of the quaternion is 0, NaN or infinite.
    """
    if not 0 < hypot(x, y, z, w) < inf:
        raise ValueError(f"the rotation must have a finite, non-zero length, got {(x, y, z, w)}")
    # The products of a quaternion of three turns (J. Diebel, Representing Attitude, 2006), added: w + y is
    # (cos + sin)(pitch / 2) cos((roll - yaw) / 2), and so on. Unlike an arc sine, they lose no digits near
    # gimbal lock, and the length cancels.
    up, down = hypot(w + y, x - z), hypot(w - y, x + z)  # sqrt(2) cos and sin of (pi/2 - pitch) / 2
    half_difference, half_sum = atan2(x - z, w + y), atan2(x + z, w - y)
    if 2 * min(up, down) < GIMBAL_LOCK * max(up, down):
        roll = 2 * (half_difference if up > down else half_sum)
        return remainder(roll, tau), copysign(pi / 2, up - down), 0.0
    roll, yaw = half_sum + half_difference, half_sum - half_difference
    return remainder(roll, tau), 2 * atan2(up, down) - pi / 2, remainder(yaw, tau)
