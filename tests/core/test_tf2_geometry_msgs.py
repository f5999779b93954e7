# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Points and poses as tf2 transforms them, and what single types accept; all: test_every_message_type.py."""

import array
import math
import textwrap
from collections import UserList
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("hypothesis")
from geometry_msgs.msg import (
    Point,
    Point32,
    PointStamped,
    Polygon,
    Pose,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    TransformStamped,
)
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Path
from numpy.testing import assert_allclose
from processes import output_of
from random_messages import AWKWARD_TURNS, Maker, transforms, turns
from textbook_transforms import covariance_rotated, turn, xyz, xyzw
from times_and_transforms import about_z, transform

import tf2_geometry_msgs as tf2
from tf2_geometry_msgs.tf2_geometry_msgs import (
    _build_affine,
    _decompose_affine,
    _get_mat_from_quat,
    _get_quat_from_mat,
    _transform_to_affine,
)

NAN, INF = math.nan, math.inf


def close(got, wanted):
    # Rounding grows with the numbers that go in, which reach 1e6.
    assert_allclose(got, wanted, rtol=1e-12, atol=1e-8)


def made(cls, numbers):
    """A message of x y z and w."""
    return cls(**dict(zip("xyzw", map(float, numbers), strict=False)))


def pose(position, q):
    return Pose(position=made(Point, position), orientation=made(Quaternion, q))


def test_an_orientation_without_length_is_no_rotation_and_a_coordinate_may_be_nan():
    t = transform("map", "base", 0, (1, 2, 3), about_z(1))
    got = tf2.do_transform_pose(pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)), t)
    assert_allclose(xyzw(got.orientation), about_z(1))
    assert np.isnan(xyz(tf2.do_transform_point(made(Point, [NAN] * 3), t))).all()
    for wrong in (NAN, INF):
        got = tf2.do_transform_pose(pose((wrong, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0)), t)
        assert not np.isfinite(xyz(got.position)[:2]).any()
        assert_allclose(xyzw(got.orientation), about_z(1))


@pytest.mark.parametrize("length", [1e-300, 1e-200, 1.6e-162, 1e-155, 1e150, 1e200, 1e300])
@pytest.mark.parametrize("q", AWKWARD_TURNS)
def test_an_orientation_of_any_length_counts(q, length):
    t = transform("map", "base", 0, xyzw=(0.1, 0.2, 0.3, 0.9))
    got = tf2.do_transform_quaternion(made(Quaternion, np.multiply(q, length)), t)
    wanted = tf2.do_transform_quaternion(made(Quaternion, q), t)
    assert_allclose(xyzw(got), xyzw(wanted), atol=1e-14)


square = st.lists(st.floats(-1e3, 1e3), min_size=36, max_size=36)


@given(square, transforms)
def test_a_covariance_is_rotated_in_all_four_blocks(values, t):
    got = tf2.transform_covariance(values, t)
    assert type(got) is np.ndarray and got.dtype == np.float64 and got.shape == (36,)
    assert_allclose(got.reshape(6, 6), covariance_rotated(values, turn(t.transform.rotation)), atol=1e-9)
    # A symmetric one stays symmetric to the last bit.
    half = np.reshape(values, (6, 6))
    got = tf2.transform_covariance((half + half.T).ravel(), t).reshape(6, 6)
    assert np.array_equal(got, got.T)


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        *[(wrong, ValueError) for wrong in ([1.0] * 35, np.zeros((6, 7)), [])],
        *[(wrong, TypeError) for wrong in (None, "x" * 36, ["a"] * 36, {1, 2})],
    ],
)
def test_a_covariance_is_36_numbers(wrong, error):
    with pytest.raises(error, match="36 numbers"):
        tf2.transform_covariance(wrong, TransformStamped())


WAYS = {
    "ndarray": np.asarray,
    "matrix": lambda values: np.reshape(values, (6, 6)),
    "fortran": lambda values: np.asfortranarray(np.reshape(values, (6, 6))),
    "strided": lambda values: np.repeat(values, 2)[::2],
    "read-only": lambda values: np.frombuffer(np.asarray(values).tobytes()),
    "other byte order": lambda values: np.asarray(values).astype(">f8"),
    "array.array": lambda values: array.array("d", values),
    "list": list,
    "tuple": tuple,
    "UserList": UserList,
}


@pytest.mark.parametrize("way", WAYS)
def test_a_covariance_may_come_in_every_form(way):
    maker = Maker(1)
    values = maker.covariance().tolist()
    t = transform("map", "base", 0, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))
    form, wanted = WAYS[way](values), covariance_rotated(values, turn(t.transform.rotation))
    assert_allclose(tf2.transform_covariance(form, t), wanted.ravel(), atol=1e-12)
    message = PoseWithCovariance(pose=maker.pose(), covariance=form)
    got = tf2.do_transform_pose_with_covariance(message, t)
    assert np.array_equal(got.covariance, tf2.transform_covariance(values, t))


@pytest.mark.parametrize("count", [0, 1, 1000])
@pytest.mark.parametrize("sequence", [list, tuple, UserList])
def test_a_polygon_may_have_any_number_of_corners_in_any_sequence(count, sequence):
    corners = [Point32(x=float(i), y=2.0, z=-1.0) for i in range(count)]
    t = transform("map", "base", 0, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))
    got = tf2.do_transform_polygon(Polygon(points=sequence(corners)), t)
    assert type(got.points) is list
    assert got.points == [tf2.do_transform_point(corner, t) for corner in corners]


def test_the_poses_of_a_path_keep_their_stamps_and_change_their_frame():
    path = Maker(20).message(Path)
    path.poses[1].header.frame_id = ""
    t = transform("map", "base", 7.25, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))
    got = tf2.do_transform_path(path, t)
    assert [p.header.stamp for p in got.poses] == [p.header.stamp for p in path.poses]
    assert {p.header.frame_id for p in got.poses} == {"map"}
    path.poses[2].header.frame_id = "camera"
    with pytest.raises(
        ValueError, match="frame of the path, 'base', or no frame for each pose, got 'camera'"
    ):
        tf2.do_transform_path(path, transform("map", "base"))


def test_objects_with_the_fields_will_do():
    duck = SimpleNamespace(point=SimpleNamespace(x=1, y=np.float32(2), z=3.0))
    header = SimpleNamespace(frame_id="map", stamp=SimpleNamespace(sec=7, nanosec=5))
    t = SimpleNamespace(
        header=header,
        transform=SimpleNamespace(
            translation=SimpleNamespace(x=1, y=0, z=0), rotation=SimpleNamespace(x=0, y=0, z=1, w=1)
        ),
    )
    got = tf2.do_transform_point(duck, t)
    assert type(got) is PointStamped
    assert (got.header.frame_id, got.header.stamp.sec, got.header.stamp.nanosec) == ("map", 7, 5)
    close(xyz(got.point), (-1, 1, 3))


# The NumPy helpers that programs take from tf2's module, by private names and by accident.


def wxyz(q):
    return np.array([q[3], *q[:3]])


@pytest.mark.tf2
@given(turns)
def test_a_quaternion_and_its_matrix(q):
    matrix = _get_mat_from_quat(wxyz(q))
    assert_allclose(matrix, turn(q).as_matrix(), atol=1e-12)
    back = _get_quat_from_mat(matrix)
    assert_allclose(np.linalg.norm(back), 1)
    assert back[0] >= 0
    assert_allclose(_get_mat_from_quat(back), matrix, atol=1e-9)


@pytest.mark.tf2
def test_no_quaternion_is_no_rotation_and_what_is_not_quite_one_has_a_nearest():
    for q in ((0.0, 0.0, 0.0, 0.0), (1e-9, 0.0, 0.0, 0.0)):
        assert np.array_equal(_get_mat_from_quat(np.array(q)), np.eye(3))
    rotation = turn((0.1, 0.2, 0.3, 0.9))
    got = _get_quat_from_mat(rotation.as_matrix() + 1e-3 * np.arange(9).reshape(3, 3))
    assert_allclose(got, wxyz(rotation.q), atol=5e-3)
    assert_allclose(np.linalg.norm(got), 1)


@pytest.mark.tf2
def test_an_affine_matrix_is_built_and_taken_apart():
    affine = _build_affine([0.5, 0.5, 0.5, 0.5], (1, 2, 3))
    assert_allclose(affine, [[0, 0, 1, 1], [1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 0, 1]], atol=1e-15)
    rotation, translation = _decompose_affine(affine)
    assert_allclose(rotation, (0.5, 0.5, 0.5, 0.5))
    assert translation.tolist() == [1, 2, 3]
    assert np.array_equal(_build_affine(), np.eye(4))
    assert _build_affine(translation=[7, 8, 9])[:3, 3].tolist() == [7, 8, 9]
    assert_allclose(_transform_to_affine(transform("a", "b", 1, (1, 2, 3), (0.5, 0.5, 0.5, 0.5))), affine)
    with pytest.raises(AttributeError):
        _transform_to_affine(PoseWithCovarianceStamped())


def test_geometry_needs_no_nav_msgs():
    program = """
        import importlib.abc, sys
        class Without(importlib.abc.MetaPathFinder):
            def find_spec(self, name, path, target=None):
                if name.partition(".")[0] == "nav_msgs":
                    raise ModuleNotFoundError(f"No module named {name!r}", name="nav_msgs")
        sys.meta_path.insert(0, Without())
        from tf2_geometry_msgs import __all__ as names
        print("do_transform_pose" in names, "do_transform_path" in names)
    """
    assert output_of("-c", textwrap.dedent(program)).split() == ["True", "False"]
