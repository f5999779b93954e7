"""Buffers that forget frames which have fallen silent."""

import copy

import pytest
from making import transform
from processes import until
from rclpy.clock import Clock

pytestmark = pytest.mark.ours
DAY_NS = 86400 * 10**9


@pytest.fixture
def now_ns():
    return Clock().now().nanoseconds


def test_frames_with_old_transforms_are_forgotten_and_others_stay(tf2_ros, now_ns):
    buffer = tf2_ros.Buffer(expire_after=3600.0)
    buffer.set_transform(transform("map", "fresh", ns=now_ns + DAY_NS), "x")
    buffer.set_transform_static(transform("map", "fixed"), "x")
    buffer.set_transform(transform("map", "silent", ns=now_ns - DAY_NS), "x")
    buffer.set_transform(transform("silent", "below", ns=now_ns - DAY_NS), "x")
    until(lambda: "silent" not in buffer)
    assert sorted(buffer.frames()) == ["fixed", "fresh", "map"]
    buffer.set_transform(transform("map", "silent", ns=now_ns + DAY_NS), "x")
    assert buffer.parent("silent") == "map"


def test_a_node_is_followed_by_its_clock(tf2_ros, node, executor, peer):
    from rclpy.parameter import Parameter

    node.set_parameters([Parameter("use_sim_time", value=True)])
    buffer = tf2_ros.Buffer(node=node, expire_after=10)
    other = peer()

    def tick():
        other.set_clock(1000)
        executor.spin_once(timeout_sec=0)
        return buffer.clock.now().nanoseconds == 1000 * 10**9

    until(tick)
    buffer.set_transform(transform("map", "fresh", 995), "x")
    buffer.set_transform(transform("map", "silent", 980), "x")
    until(lambda: "silent" not in buffer)
    assert "fresh" in buffer


def test_what_has_arrived_since_a_frame_was_listed_is_kept(tf2_ros, now_ns):
    buffer = tf2_ros.Buffer()
    buffer.set_transform(transform("map", "a", ns=now_ns), "x")
    buffer.set_transform_static(transform("map", "b"), "x")
    for name in ("a", "b", "map", "unknown"):
        buffer._forget_silent(name, now_ns)
    assert sorted(buffer.frames()) == ["a", "b", "map"]
    buffer._forget_silent("a", now_ns + 1)
    assert sorted(buffer.frames()) == ["b", "map"]


def test_a_copy_keeps_all(tf2_ros, now_ns):
    buffer = tf2_ros.Buffer(expire_after=3600)
    assert not hasattr(copy.copy(buffer), "_tf2_expiry")


@pytest.mark.parametrize(("after", "error"), [(0, ValueError), (-1.0, ValueError), ("1", TypeError)])
def test_a_wrong_time_is_refused(tf2_ros, after, error):
    with pytest.raises(error, match="expire_after"):
        tf2_ros.Buffer(expire_after=after)
