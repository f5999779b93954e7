# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Roll, pitch and yaw, in the order of tf2's setRPY and getRPY."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Quaternion, QuaternionStamped
from numpy.testing import assert_allclose
from rotations import Turn

from tf2_geometry_msgs import quaternion_from_rpy, rpy_from_quaternion

QUARTER = math.pi / 2


def numbers(q):
    return [q.x, q.y, q.z, q.w]


def made(q):
    return Quaternion(**dict(zip("xyzw", map(float, q), strict=True)))


def get_rpy(q):
    """As tf2::Matrix3x3::getRPY does, away from gimbal lock."""
    m = Turn(q).as_matrix()
    return math.atan2(m[2, 1], m[2, 2]), -math.asin(m[2, 0]), math.atan2(m[1, 0], m[0, 0])


def test_the_turns_about_the_fixed_axes_x_y_z_follow_one_another():
    for angles in np.random.default_rng(1).uniform(-7, 7, (500, 3)):
        got = quaternion_from_rpy(*angles)
        assert isinstance(got, Quaternion)
        q = Turn.from_angles(*angles).q  # the sign of setRPY, too
        assert_allclose(numbers(got), q, atol=1e-14)


def test_the_angles_are_those_of_get_rpy_for_any_length_and_sign():
    random = np.random.default_rng(2)
    for q in Turn.random(random, 500).q:
        wanted = get_rpy(q)
        for factor in (1.0, -1.0, 1e-150, 1e150, random.uniform(0.1, 9)):
            assert_allclose(rpy_from_quaternion(made(factor * q)), wanted, atol=1e-11)


def test_angles_within_their_ranges_come_back():
    random = np.random.default_rng(3)
    for roll, pitch, yaw in random.uniform(-1, 1, (500, 3)) * (math.pi, QUARTER - 1e-3, math.pi):
        q = quaternion_from_rpy(roll, pitch, yaw)
        assert_allclose(rpy_from_quaternion(q), (roll, pitch, yaw), atol=1e-11)
    assert rpy_from_quaternion(Quaternion()) == (0, 0, 0)


@pytest.mark.parametrize("gap", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("sign", [1, -1])
def test_near_gimbal_lock_no_digits_are_lost(gap, sign):
    pitch = sign * (QUARTER - gap)
    got = rpy_from_quaternion(quaternion_from_rpy(0.7, pitch, -0.4))
    assert got[1] == pytest.approx(pitch, abs=1e-15)
    assert got == pytest.approx((0.7, pitch, -0.4), abs=1e-15 / gap)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("roll", "yaw"), [(0, 0), (0.3, 0), (0, 0.3), (2.5, -2.9), (-3, 3), (math.pi, 0)])
def test_in_gimbal_lock_the_yaw_is_zero_and_the_rotation_the_same(roll, yaw, sign):
    q = quaternion_from_rpy(roll, sign * QUARTER, yaw)
    got = rpy_from_quaternion(q)
    assert got[1:] == (sign * QUARTER, 0.0)
    assert -math.pi <= got[0] <= math.pi
    assert math.remainder(got[0] - (roll - sign * yaw), math.tau) == pytest.approx(0, abs=1e-14)
    turned = Turn(numbers(quaternion_from_rpy(*got))).inverse() * Turn(numbers(q))
    assert turned.angle() == pytest.approx(0, abs=1e-14)


def test_what_is_no_rotation_is_refused():
    for bad in [0, 0, 0, 0], [math.nan, 0, 0, 1], [0, math.inf, 0, 1]:
        with pytest.raises(ValueError, match="finite, non-zero length, got"):
            rpy_from_quaternion(made(bad))
    for angles in (math.nan, 0, 0), (0, math.inf, 0), (0, 0, -math.inf):
        with pytest.raises(ValueError, match="must be finite, got"):
            quaternion_from_rpy(*angles)
    with pytest.raises(TypeError):
        quaternion_from_rpy("1", 0, 0)
    for other in QuaternionStamped(), Quaternion, (0.0, 0.0, 0.0, 1.0):
        with pytest.raises(TypeError, match=f"expected a .*/Quaternion, got {type(other).__name__}: "):
            rpy_from_quaternion(other)
    assert rpy_from_quaternion(SimpleNamespace(x=0, y=0, z=0, w=2)) == (0, 0, 0)
