# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Roll, pitch and yaw of rotations, and back."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tf2_ros_tools.common.roll_pitch_yaw import quaternion_from_rpy, rpy_from_matrices


def test_they_are_those_of_scipy_and_back():
    for rotation in Rotation.random(200, random_state=1):
        rpy = rpy_from_matrices(rotation.as_matrix())
        assert rpy == pytest.approx(tuple(rotation.as_euler("xyz")), abs=1e-9)
        q = np.array(quaternion_from_rpy(*rpy))
        assert abs(q @ rotation.as_quat()) == pytest.approx(1.0)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
@pytest.mark.parametrize("roll", [-3.0, 0.0, 0.7])
def test_where_roll_and_yaw_are_one_turn_yaw_is_zero(roll, pitch):
    matrix = (
        np.round(Rotation.from_euler("y", pitch).as_matrix()) @ Rotation.from_euler("x", roll).as_matrix()
    )
    assert rpy_from_matrices(matrix) == pytest.approx((roll, pitch, 0.0))
