"""Transforms as rotations of SciPy, and back."""

import math
from functools import partial

import numpy as np
import pytest
from expected_transforms import xyzw
from geometry_msgs.msg import Pose, Quaternion, QuaternionStamped
from hypothesis import given
from making_objects import transform
from numpy.testing import assert_allclose
from random_messages import turns
from rotations import Turn

from tf2_ros.numpy import from_rotation, to_rotation

Rotation = pytest.importorskip("scipy.spatial.transform").Rotation

pytestmark = [pytest.mark.ours, pytest.mark.long("needs SciPy")]


@given(turns)
def test_a_message_becomes_the_rotation_of_scipy(q):
    t = transform("map", "base", 0, (1, 2, 3), q)
    quaternion = t.transform.rotation
    messages = (
        t,
        t.transform,
        Pose(orientation=quaternion),
        quaternion,
        QuaternionStamped(quaternion=quaternion),
    )
    arrays = ((np.zeros(3), np.array(q)), np.array(q))
    for one in (*messages, *arrays):
        got = to_rotation(one)
        assert isinstance(got, Rotation)
        assert_allclose(got.as_quat(), Turn(q).q, rtol=0, atol=1e-15)
    many = to_rotation(np.array([q, q]))
    assert_allclose(many.as_quat(), [Turn(q).q] * 2, rtol=0, atol=1e-15)


@given(turns)
def test_a_rotation_becomes_the_message_it_came_from(q):
    got = from_rotation(Rotation.from_quat(q))
    assert type(got) is Quaternion and got.w >= 0
    assert_allclose(abs(xyzw(got) @ Turn(q).q), 1, rtol=0, atol=1e-15)
    assert_allclose(np.linalg.norm(xyzw(got)), 1, rtol=0, atol=1e-15)
    assert_allclose(to_rotation(got).as_matrix(), Turn(q).as_matrix(), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (partial(to_rotation, np.eye(4) * 1j), TypeError, "numbers: complex numbers are not supported"),
        (partial(to_rotation, 5), TypeError, "expected a TransformStamped, Transform, PoseStamped or Pose"),
        (partial(from_rotation, Rotation.identity(3)), ValueError, "rotation: expected one rotation, got 3"),
        (partial(from_rotation, to_rotation([math.nan] * 4)), ValueError, "finite"),
    ],
    ids=("complex", "no message", "three rotations", "missing"),
)
def test_what_is_not_one_rotation_is_refused(call, error, text):
    with pytest.raises(error, match=text):
        call()
