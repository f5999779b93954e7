"""Messages as matrices and arrays, judged by SciPy."""

import math
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from expected import matrix, turn, xyz, xyzw
from geometry_msgs.msg import Point, Pose, PoseStamped, Transform, TransformStamped, Twist
from hypothesis import given
from making import rotation, transform, translation
from numpy.testing import assert_allclose
from random_messages import AWKWARD_TURNS, transforms, turns, vectors
from scipy.spatial.transform import Rotation

from tf2_ros.numpy import from_matrix, to_arrays, to_matrix

pytestmark = pytest.mark.ours


def pose_of(t):
    position = Point(**dict(zip("xyz", translation(t), strict=True)))
    return Pose(position=position, orientation=t.transform.rotation)


@given(transforms)
def test_a_matrix_is_what_scipy_makes(t):
    got = to_matrix(t)
    assert got.dtype == np.float64 and got.shape == (4, 4)
    assert_allclose(got, matrix(t), rtol=1e-12, atol=1e-12)
    for same in (t.transform, pose_of(t), PoseStamped(pose=pose_of(t))):
        assert np.array_equal(to_matrix(same), got)


@given(transforms)
def test_a_matrix_becomes_the_message_it_came_from(t):
    got = from_matrix(to_matrix(t))
    assert type(got) is Transform
    assert_allclose(xyz(got.translation), translation(t))
    assert_allclose(turn(got.rotation).as_matrix(), turn(t.transform.rotation).as_matrix(), atol=1e-12)
    assert math.isclose(np.linalg.norm(xyzw(got.rotation)), 1) and got.rotation.w >= 0


@pytest.mark.parametrize("q", AWKWARD_TURNS)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_half_turns_and_tiny_turns_lose_nothing(q, dtype):
    m = np.eye(4, dtype=dtype)
    m[:3, :3] = turn(q).as_matrix()
    got = xyzw(from_matrix(m).rotation)
    assert_allclose(abs(got @ turn(q).as_quat()), 1, atol=1e-6 if dtype == np.float32 else 1e-15)


@pytest.mark.parametrize("cls", [Transform, TransformStamped, Pose, PoseStamped])
def test_a_matrix_becomes_the_class_asked_for(cls):
    m = to_matrix(transform("map", "base", 0, (1, 2, 3), (0.5, 0.5, 0.5, 0.5)))
    got = from_matrix(m, cls)
    assert type(got) is cls
    assert_allclose(to_matrix(got), m, atol=1e-15)


def test_another_class_is_a_type_error():
    with pytest.raises(TypeError, match="Transform or a Pose"):
        from_matrix(np.eye(4), Twist)


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (np.eye(3), r"shape \(4, 4\), not \(3, 3\)"),
        (np.zeros((1, 4, 4)), r"shape \(4, 4\)"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), "orthogonal; R R.T is off by 3"),
        (np.diag([1.0, 1.0, 1.0 + 1e-4, 1.0]), "orthogonal"),
        (np.zeros((4, 4)) + np.diag([0, 0, 0, 1]), "orthogonal"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "reflection"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), "last row"),
        (np.eye(4) + np.eye(4)[::-1], "last row"),
        (np.full((4, 4), math.nan), "finite"),
        (np.diag([1.0, 1.0, 1.0, math.inf]), "finite"),
    ],
)
def test_a_matrix_that_is_no_rigid_transform_is_a_value_error(wrong, reason):
    with pytest.raises(ValueError, match=reason):
        from_matrix(wrong)


@pytest.mark.parametrize("wrong", [None, "matrix", [["a"] * 4] * 4, {}])
def test_a_matrix_of_no_numbers_is_refused(wrong):
    with pytest.raises((TypeError, ValueError), match="a matrix must"):
        from_matrix(wrong)


def test_a_matrix_that_was_rounded_to_float32_is_near_enough():
    m = np.eye(4, dtype=np.float32)
    for angle in range(100):
        m[:3, :3] = m[:3, :3] @ Rotation.from_euler("xyz", [angle, 1, 2]).as_matrix().astype(np.float32)
    assert_allclose(to_matrix(from_matrix(m)), m, atol=1e-5)


@given(vectors, turns)
def test_arrays_hold_translations_and_rotations_row_by_row(v, q):
    messages = [transform("map", "base", 0, v, q), Transform(), pose_of(transform("a", "b", 0, v, q))]
    translations, rotations = to_arrays(iter(messages))
    assert translations.dtype == rotations.dtype == np.float64
    assert translations.shape == (3, 3) and rotations.shape == (3, 4)
    assert np.array_equal(translations, [v, (0, 0, 0), v])
    unit = np.array(q) / np.linalg.norm(q)
    assert_allclose(rotations, [unit, (0, 0, 0, 1), unit], atol=1e-15)
    scipy = Rotation.from_quat(rotations)
    assert_allclose(scipy[0].as_matrix(), to_matrix(messages[0])[:3, :3], atol=1e-12)


@pytest.mark.parametrize("length", [1e-300, 1e-200, 1.6e-162, 1e-155, 1e150, 1e200, 1e300])
@pytest.mark.parametrize("q", AWKWARD_TURNS)
def test_a_rotation_of_any_length_counts(q, length):
    _, rotations = to_arrays([transform("map", "base", 0, xyzw=np.multiply(q, length))])
    assert_allclose(rotations[0], np.array(q) / np.linalg.norm(q), atol=1e-14)


def test_arrays_of_nothing_have_their_shapes():
    translations, rotations = to_arrays([])
    assert translations.shape == (0, 3) and rotations.shape == (0, 4)


def test_the_arrays_are_not_views_of_one_another():
    translations, rotations = to_arrays([Transform(), Transform()])
    translations[:] = 5
    assert rotations.tolist() == [[0, 0, 0, 1]] * 2
    assert translations.flags.c_contiguous and rotations.flags.c_contiguous


@pytest.mark.parametrize("q", [(0, 0, 0, 0), (math.nan, 0, 0, 1), (0, math.inf, 0, 0)])
def test_a_rotation_without_length_is_a_value_error(q):
    t = transform("map", "base", 0, xyzw=q)
    with pytest.raises(ValueError, match="rotation of message 0"):
        to_matrix(t)
    with pytest.raises(ValueError, match="rotation of message 1"):
        to_arrays([Transform(), t])


@pytest.mark.parametrize("wrong", [None, 5, "text", Twist(), [Transform()]], ids=lambda w: type(w).__name__)
def test_another_message_is_a_type_error(wrong):
    with pytest.raises(TypeError, match="expected a TransformStamped, Transform, PoseStamped or Pose"):
        to_matrix(wrong)
    with pytest.raises(TypeError, match="expected a TransformStamped, Transform, PoseStamped or Pose"):
        to_arrays([wrong])


def test_a_field_that_is_no_number_is_a_type_error():
    t = Transform()
    t.translation._x = "one"
    with pytest.raises(TypeError, match="must be numbers"):
        to_matrix(t)


def test_objects_with_the_fields_will_do():
    duck = SimpleNamespace(
        position=SimpleNamespace(x=1, y=2, z=3), orientation=SimpleNamespace(x=0, y=0, z=1, w=1)
    )
    assert_allclose(to_matrix(duck) @ [1, 0, 0, 1], (1, 3, 3, 1), atol=1e-15)
    assert rotation(from_matrix(to_matrix(duck), TransformStamped)) == pytest.approx(
        (0, 0, math.sqrt(0.5), math.sqrt(0.5))
    )


def test_numpy_is_still_numpy_for_the_modules_beside_it():
    code = "import tf2_ros.numpy, numpy; print(tf2_ros.numpy.np is numpy, numpy.ndarray.__module__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "True numpy\n"), done.stderr
