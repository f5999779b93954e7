# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Convert rotations to roll, pitch and yaw."""

from typing import Any


def rpy_from_matrices(matrices: Any) -> Any:
    """
    Get the turns about the fixed axes x, y and z, in this order, in radians.

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
