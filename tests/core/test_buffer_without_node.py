# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A buffer without a node and without ROS's classes: with ROS and, by test_without_ros.py, without it."""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest

S = 10**9


def transform(tf2_ros, x, stamp_ns=0, parent="base_link", child="camera"):
    made = tf2_ros.TransformStamped(child_frame_id=child)
    made.header.frame_id = parent
    made.header.stamp.sec, made.header.stamp.nanosec = divmod(stamp_ns, S)
    made.transform.translation.x = x
    return made


@pytest.fixture
def buffer(tf2_ros):
    """The camera moves at 1 m/s between 10 s and 20 s."""
    buffer = tf2_ros.Buffer()
    for stamp_s in (10, 15, 20):
        buffer.set_transform(transform(tf2_ros, float(stamp_s), stamp_s * S), "example")
    return buffer


class TestLookups:
    def test_a_time_may_be_of_any_kind(self, buffer, tf2_ros):
        times = (SimpleNamespace(sec=12, nanosec=0), SimpleNamespace(nanoseconds=12 * S))
        for time_asked in (12 * S, np.datetime64(12 * S, "ns"), *times):
            found = buffer.lookup_transform("base_link", "camera", time_asked)
            assert found.transform.translation.x == pytest.approx(12.0)
            assert (found.header.frame_id, found.child_frame_id) == ("base_link", "camera")
            assert (found.header.stamp.sec, found.header.stamp.nanosec) == (12, 0)
            assert type(found) is tf2_ros.TransformStamped

    def test_many_times_and_points_and_the_velocity(self, buffer):
        translations, rotations = buffer.lookup_transforms("base_link", "camera", [10 * S, 12 * S])
        assert translations[:, 0] == pytest.approx([10.0, 12.0]) and rotations.shape == (2, 4)
        points = buffer.transform_points(np.zeros((1, 3)), [12 * S], "base_link", "camera")
        assert points == pytest.approx(np.array([[12.0, 0.0, 0.0]]))
        linear, _ = buffer.lookupVelocityCore(
            "camera", "base_link", 15 * S, SimpleNamespace(sec=2, nanosec=0)
        )
        assert linear == pytest.approx([1.0, 0.0, 0.0])

    def test_its_errors_are_those_of_tf2(self, buffer, tf2_ros):
        for error, text, arguments in (
            (tf2_ros.LookupException, '^"lidar" passed to lookupTransform', ("base_link", "lidar", 0)),
            (tf2_ros.ExtrapolationException, "into the future", ("base_link", "camera", 21 * S)),
            (tf2_ros.InvalidArgumentException, "/base_link", ("/base_link", "camera", 0, 600.0)),  # at once
            (TypeError, "expected", ("base_link", "camera", "now")),
        ):
            with pytest.raises(error, match=text):
                buffer.lookup_transform(*arguments)
        assert buffer.can_transform("base_link", "lidar", 0) is False

    def test_a_registered_type_is_transformed(self, buffer, tf2_ros):
        class Ahead:
            def __init__(self, x, frame):
                self.x = x
                self.header = tf2_ros.Header(frame_id=frame)

        def do_transform(ahead, found):
            return Ahead(ahead.x + found.transform.translation.x, found.header.frame_id)

        tf2_ros.TransformRegistration().add(Ahead, do_transform)
        moved = buffer.transform(Ahead(1.0, "camera"), "base_link")
        assert (moved.x, moved.header.frame_id) == (21.0, "base_link")


def test_a_refused_transform_is_logged(buffer, tf2_ros, capfd, caplog):
    buffer.set_transform(transform(tf2_ros, 1.0, parent="camera"), "example")
    assert "TF_SELF_TRANSFORM" in capfd.readouterr().err + caplog.text


def test_its_parameters_are_those_of_a_node(tf2_ros):
    buffer = tf2_ros.Buffer(SimpleNamespace(nanoseconds=5 * S), max_frames=10)
    for stamp_s in (10, 20, 30):
        buffer.set_transform(transform(tf2_ros, 1.0, stamp_s * S), "example")
    assert not buffer.can_transform("base_link", "camera", 10 * S)
    with pytest.raises(ValueError, match="cache_time"):
        tf2_ros.Buffer(SimpleNamespace(nanoseconds=-1))
    assert pickle.loads(pickle.dumps(tf2_ros.Buffer)) is tf2_ros.Buffer is tf2_ros.buffer.Buffer


def test_a_matrix_becomes_a_message_and_a_message_a_matrix(buffer, tf2_ros):
    from tf2_ros.numpy import from_matrix, to_arrays, to_columns, to_matrix

    found = buffer.lookup_transform("base_link", "camera", 12 * S)
    made = from_matrix(to_matrix(found), header=found.header, child_frame_id="camera")
    assert made == found and type(made) is tf2_ros.TransformStamped
    pose = SimpleNamespace(position=found.transform.translation, orientation=found.transform.rotation)
    assert to_arrays([pose])[0].tolist() == to_arrays([found])[0].tolist()
    assert to_columns([found])["stamp_ns"].tolist() == [12 * S]


def test_a_stamped_object_has_a_header(tf2_ros):
    stamped = tf2_ros.Stamped(SimpleNamespace(), 1_500_000_000, "map")
    assert stamped.header == tf2_ros.Header(frame_id="map", stamp=stamped.header.stamp)
    assert (stamped.header.stamp.sec, stamped.header.stamp.nanosec) == (1, 500_000_000)
