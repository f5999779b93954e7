# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Convert rotations to roll, pitch and yaw, and back.

These are turns about the fixed axes x, y and z, in this order, in radians.
"""

from math import cos, sin
from typing import Any


def rpy_from_matrices(matrices: Any) -> Any:
    """
    Get the roll, pitch and yaw of rotations.

    :param matrices: an array of matrices, or one matrix, with the rotation in the upper left 3 x 3 numbers.
    :return: an array of shape (..., 3); the pitch is from -pi/2 to pi/2. At these two limits, where roll and
        yaw turn about the same axis, yaw is 0.
    """
    import numpy as np

    m = np.asarray(matrices)
    pole = np.abs(m[..., 2, 0]) >= 1.0
    roll = np.where(pole, np.arctan2(-m[..., 1, 2], m[..., 1, 1]), np.arctan2(m[..., 2, 1], m[..., 2, 2]))
    pitch = -np.arcsin(np.clip(m[..., 2, 0], -1.0, 1.0))
    yaw = np.where(pole, 0.0, np.arctan2(m[..., 1, 0], m[..., 0, 0]))
    return np.stack([roll, pitch, yaw], axis=-1)


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
