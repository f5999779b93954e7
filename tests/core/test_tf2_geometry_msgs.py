"""What each type of geometry_msgs becomes in another frame, by arithmetic that shares no code with it."""

import array
import math
from collections import UserList
from types import SimpleNamespace

import numpy as np
import pytest
from expected import covariance_rotated, matrix, transformed, turn, xyz, xyzw
from geometry_msgs.msg import (
    AccelStamped,
    Point,
    Point32,
    PointStamped,
    Polygon,
    Pose,
    PoseWithCovariance,
    Quaternion,
    TransformStamped,
    Twist,
    TwistStamped,
    Vector3,
    Vector3Stamped,
    VelocityStamped,
    Wrench,
)
from hypothesis import given
from hypothesis import strategies as st
from making import about_z, transform
from nav_msgs.msg import Odometry, Path
from numpy.testing import assert_allclose
from random_messages import AWKWARD_TURNS, Maker, transforms, turns, vectors

import tf2_geometry_msgs as tf2

ours = pytest.mark.ours

NAN, INF = math.nan, math.inf


def close(got, wanted):
    # Rounding grows with the numbers that go in, which reach 1e6.
    assert_allclose(got, wanted, rtol=1e-12, atol=1e-8)


def made(cls, numbers):
    """A message of x y z and w."""
    return cls(**dict(zip("xyzw", map(float, numbers), strict=False)))


def pose(position, q):
    return Pose(position=made(Point, position), orientation=made(Quaternion, q))


@given(vectors, transforms)
def test_a_point_is_rotated_and_moved_a_vector_rotated(v, t):
    point = tf2.do_transform_point(PointStamped(point=made(Point, v)), t).point
    close(xyz(point), transformed(np.array([v]), t)[0])
    vector = tf2.do_transform_vector3(Vector3Stamped(vector=made(Vector3, v)), t).vector
    close(xyz(vector), turn(t.transform.rotation).apply(v))


@given(vectors, turns, transforms)
def test_a_pose_is_the_product_of_two_matrices(p, q, t):
    got = tf2.do_transform_pose(pose(p, q), t)
    product = matrix(t) @ matrix(transform("base", "tool", 0, p, q))
    close(xyz(got.position), product[:3, 3])
    assert_allclose(turn(got.orientation).as_matrix(), product[:3, :3], atol=1e-12)


@ours
@given(vectors, turns, transforms)
def test_a_transform_goes_behind_another_as_a_pose_does(p, q, t):
    got, as_pose = tf2.do_transform_transform_stamped(transform("base", "tool", 1, p, q), t), pose(p, q)
    wanted = tf2.do_transform_pose(as_pose, t)
    assert np.array_equal(xyz(got.transform.translation), xyz(wanted.position))
    assert got.transform.rotation == wanted.orientation == tf2.do_transform_quaternion(as_pose.orientation, t)
    assert math.isclose(np.linalg.norm(xyzw(wanted.orientation)), 1) and wanted.orientation.w >= 0
    assert (got.header.frame_id, got.child_frame_id) == ("map", "tool")


@ours
def test_an_orientation_without_length_is_no_rotation_and_nan_stays_nan():
    t = transform("map", "base", 0, (1, 2, 3), about_z(1))
    got = tf2.do_transform_pose(pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)), t)
    assert_allclose(xyzw(got.orientation), about_z(1))
    assert np.isnan(xyz(tf2.do_transform_point(made(Point, [NAN] * 3), t))).all()
    for wrong in (NAN, INF):
        got = tf2.do_transform_pose(pose((1.0, 2.0, 3.0), (0.0, 0.0, wrong, 1.0)), t)
        assert np.isnan(xyzw(got.orientation)).all()
        close(xyz(got.position), transformed(np.array([[1, 2, 3]]), t)[0])


@ours
@pytest.mark.parametrize("length", [1e-300, 1e-200, 1.6e-162, 1e-155, 1e150, 1e200, 1e300])
@pytest.mark.parametrize("q", AWKWARD_TURNS)
def test_an_orientation_of_any_length_counts(q, length):
    t = transform("map", "base", 0, xyzw=(0.1, 0.2, 0.3, 0.9))
    got = tf2.do_transform_quaternion(made(Quaternion, np.multiply(q, length)), t)
    wanted = tf2.do_transform_quaternion(made(Quaternion, q), t)
    assert_allclose(xyzw(got), xyzw(wanted), atol=1e-14)


square = st.lists(st.floats(-1e3, 1e3), min_size=36, max_size=36)


@ours
@given(square, transforms)
def test_a_covariance_is_rotated_in_all_four_blocks(values, t):
    got = tf2.transform_covariance(values, t)
    assert type(got) is np.ndarray and got.dtype == np.float64 and got.shape == (36,)
    assert_allclose(got.reshape(6, 6), covariance_rotated(values, t), atol=1e-9)
    # A symmetric one stays symmetric to the last bit.
    half = np.reshape(values, (6, 6))
    got = tf2.transform_covariance((half + half.T).ravel(), t).reshape(6, 6)
    assert np.array_equal(got, got.T)


@ours
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


@ours
@pytest.mark.parametrize("way", WAYS)
def test_a_covariance_may_come_in_every_form(way):
    maker = Maker(1)
    values = maker.covariance().tolist()
    t = transform("map", "base", 0, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))
    form = WAYS[way](values)
    assert_allclose(
        tf2.transform_covariance(form, t).reshape(6, 6), covariance_rotated(values, t), atol=1e-12
    )
    message = PoseWithCovariance(pose=maker.pose(), covariance=form)
    got = tf2.do_transform_pose_with_covariance(message, t)
    assert np.array_equal(got.covariance, tf2.transform_covariance(values, t))


@ours
@pytest.mark.parametrize("count", [0, 1, 3, 1000])
@pytest.mark.parametrize("sequence", [list, tuple, UserList])
def test_a_polygon_is_transformed_point_by_point(count, sequence):
    corners = np.random.default_rng(count).uniform(-100, 100, (count, 3))
    polygon = Polygon(points=sequence(Point32(x=x, y=y, z=z) for x, y, z in corners.tolist()))
    t = transform("map", "base", 0, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))
    got = tf2.do_transform_polygon(polygon, t)
    assert type(got.points) is list and {type(p) for p in got.points} <= {Point32}
    close(np.array([xyz(p) for p in got.points]).reshape(-1, 3), transformed(corners, t))


@ours
@given(vectors, vectors, transforms)
def test_a_force_has_its_torque_about_the_new_origin(force, torque, t):
    got = tf2.do_transform_wrench(Wrench(force=made(Vector3, force), torque=made(Vector3, torque)), t)
    r = turn(t.transform.rotation)
    assert_allclose(xyz(got.force), r.apply(force), rtol=1e-12, atol=1e-8)
    # The moment of the force about the new origin, from two points on its line.
    ends = transformed(np.array([[0, 0, 0], force]), t)
    moment = np.cross(ends[0], ends[1])
    assert_allclose(xyz(got.torque), r.apply(torque) + moment, rtol=1e-9, atol=1e-3)


@ours
@given(vectors, vectors, transforms)
def test_a_velocity_moves_points_alike_in_both_frames(linear, angular, t):
    linear, angular = np.multiply(linear, 1e-3), np.multiply(angular, 1e-3)
    twist = Twist(linear=made(Vector3, linear), angular=made(Vector3, angular))
    got = tf2.do_transform_velocity_stamped(VelocityStamped(velocity=twist), t).velocity
    point = np.array([0.5, -2.0, 1.0])
    seen_in_base = linear + np.cross(angular, point)
    seen_in_map = xyz(got.linear) + np.cross(xyz(got.angular), transformed(point[None], t)[0])
    assert_allclose(seen_in_map, turn(t.transform.rotation).apply(seen_in_base), rtol=1e-9, atol=1e-4)


@ours
@pytest.mark.parametrize(("cls", "name"), [(TwistStamped, "twist"), (AccelStamped, "accel")])
def test_twist_and_acceleration_are_turned_and_not_moved(cls, name):
    message = Maker(4).message(cls)
    t = transform("map", "base", 0, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))
    got = getattr(tf2, f"do_transform_{name}_stamped")(message, t)
    for part in ("linear", "angular"):
        before, after = (getattr(getattr(m, name), part) for m in (message, got))
        close(xyz(after), turn(t.transform.rotation).apply(xyz(before)))


@ours
def test_the_poses_of_a_path_keep_their_stamps_and_change_their_frame():
    path = Maker(20).message(Path)
    path.poses[1].header.frame_id = ""
    t = transform("map", "base", 7.25, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))
    got = tf2.do_transform_path(path, t)
    assert [p.header.stamp for p in got.poses] == [p.header.stamp for p in path.poses]
    assert {p.header.frame_id for p in got.poses} == {"map"}
    assert [p.pose for p in got.poses] == [tf2.do_transform_pose(p.pose, t) for p in path.poses]
    path.poses[2].header.frame_id = "camera"
    with pytest.raises(ValueError, match="in frame 'camera', the path itself in 'base'"):
        tf2.do_transform_path(path, transform("map", "base"))


@ours
def test_an_odometry_has_its_pose_transformed_and_its_twist_left_alone():
    odometry = Maker(22).message(Odometry)
    t = transform("map", "base", 0, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))
    got = tf2.do_transform_odometry(odometry, t)
    assert got.pose == tf2.do_transform_pose_with_covariance(odometry.pose, t)
    assert got.twist == odometry.twist
    assert (got.header.frame_id, got.child_frame_id) == ("map", odometry.child_frame_id)


@ours
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
