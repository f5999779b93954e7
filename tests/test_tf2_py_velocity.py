"""Twists against motions whose derivatives are known."""

import math

import numpy as np
import pytest
from making import at, at_ns, transform
from rclpy.duration import Duration
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.ours

RATE_HZ = 200
END_S = 10
OMEGA = np.array([0.3, -0.2, 0.5])  # rad/s
V = np.array([0.4, 0.1, -0.7])  # m/s


def record(buffer, parent, child, pose):
    """10 s of a motion; ``pose(t)`` gives (xyz, Rotation)."""
    for i in range(END_S * RATE_HZ + 1):
        xyz, turn = pose(i / RATE_HZ)
        buffer.set_transform(transform(parent, child, i / RATE_HZ, xyz, turn.as_quat()), "x")


@pytest.fixture
def buffer(tf2_py):
    # The body turns evenly about its moving origin; the sensor sits on it; the tilted frame stands still.
    buffer = tf2_py.BufferCore(Duration(seconds=100))
    record(buffer, "world", "body", lambda t: (V * t, Rotation.from_rotvec(OMEGA * t)))
    buffer.set_transform_static(transform("body", "sensor", xyz=(1, 2, 3)), "x")
    buffer.set_transform_static(transform("world", "tilted", xyz=(5, 6, 7), xyzw=TILT.as_quat()), "x")
    return buffer


TILT = Rotation.from_euler("xyz", [0.4, -0.3, 1.1])


def assert_twist(got, linear, angular, tolerance=1e-6):
    np.testing.assert_allclose(got[0], linear, atol=tolerance)
    np.testing.assert_allclose(got[1], angular, atol=tolerance)


@pytest.mark.parametrize("interval", [0.01, 0.1, 1.0])
@pytest.mark.parametrize("time", [2.0, 5.003, 10.0])
def test_an_even_motion_has_its_constant_twist(buffer, time, interval):
    got = buffer.lookupVelocityCore("body", "world", at(time), Duration(seconds=interval))
    assert_twist(got, V, OMEGA)


def test_the_twist_of_the_world_seen_from_the_body_is_opposite(buffer):
    time = 4.0
    turn = Rotation.from_rotvec(OMEGA * time)
    got = buffer.lookupVelocityCore("world", "body", at(time), Duration(seconds=0.01))
    # The world's origin lies at -R^T p in the body's axes; its derivative there is -R^T (v - w x p).
    assert_twist(got, -turn.inv().apply(V - np.cross(OMEGA, V * time)), -turn.inv().apply(OMEGA), 1e-4)


def test_a_sensor_on_a_turning_body_has_a_lever_arm(buffer):
    time = 3.0
    arm = Rotation.from_rotvec(OMEGA * time).apply([1, 2, 3])
    got = buffer.lookupVelocityCore("sensor", "world", at(time), Duration(seconds=0.01))
    assert_twist(got, V + np.cross(OMEGA, arm), OMEGA, 1e-4)


def test_the_twist_is_expressed_in_the_reference_frame(buffer):
    got = buffer.lookupVelocityFullCore(
        "body", "world", "tilted", (0.0, 0.0, 0.0), "body", at(3.0), Duration(seconds=0.1)
    )
    assert_twist(got, TILT.inv().apply(V), TILT.inv().apply(OMEGA))


def test_the_linear_velocity_is_that_of_the_reference_point(buffer):
    time = 3.0
    arm = Rotation.from_rotvec(OMEGA * time).apply([0.5, -1.0, 2.0])
    got = buffer.lookupVelocityFullCore(
        "body", "world", "world", (0.5, -1.0, 2.0), "body", at(time), Duration(seconds=0.1)
    )
    assert_twist(got, V + np.cross(OMEGA, arm), OMEGA)
    # A point given in a frame that stands still: the body's point that is just there.
    arm = np.array([1.0, 0.0, 0.0]) - V * time
    got = buffer.lookupVelocityFullCore(
        "body", "world", "world", (1.0, 0.0, 0.0), "world", at(time), Duration(seconds=0.1)
    )
    assert_twist(got, V + np.cross(OMEGA, arm), OMEGA)


def test_the_interval_is_cut_at_the_newest_common_stamp(tf2_py):
    buffer = tf2_py.BufferCore(Duration(seconds=100))
    record(buffer, "world", "body", lambda t: ((t * t, 0, 0), Rotation.identity()))
    # From 9.5 s to 10 s, not to 10.5 s.
    (vx, _, _), _ = buffer.lookupVelocityCore("body", "world", at(10.0), Duration(seconds=1.0))
    assert vx == pytest.approx((10**2 - 9.5**2) / 0.5)


def test_times_are_exact_to_the_nanosecond(tf2_py):
    buffer = tf2_py.BufferCore(Duration(seconds=100))
    start = 1_700_000_000 * 10**9
    for i in range(3):
        buffer.set_transform(transform("world", "body", ns=start + i * 1000, xyz=(i * 1e-6, 0, 0)), "x")
    (vx, _, _), _ = buffer.lookupVelocityCore(
        "body", "world", at_ns(start + 1000), Duration(nanoseconds=2000)
    )
    assert vx == pytest.approx(1.0, rel=1e-9)


def test_an_interval_of_zero_is_nan(buffer):
    linear, angular = buffer.lookupVelocityCore("body", "world", at(3.0), Duration())
    assert all(math.isnan(x) for x in (*linear, *angular))


def test_time_zero_is_not_latest(buffer):
    buffer_start = buffer.lookupVelocityCore("body", "world", at(0), Duration(seconds=1.0))
    assert_twist(buffer_start, V, OMEGA, 1e-4)


def test_errors_are_those_of_the_lookups(tf2_py, buffer):
    second = Duration(seconds=1)
    with pytest.raises(tf2_py.ExtrapolationException):
        buffer.lookupVelocityCore("body", "world", at(12.0), second)
    with pytest.raises(tf2_py.LookupException):
        buffer.lookupVelocityCore("body", "nowhere", at(3.0), second)
    with pytest.raises(ValueError, match="negative"):
        buffer.lookupVelocityCore("body", "world", at(3.0), Duration(seconds=-1))
    with pytest.raises((TypeError, ValueError)):
        buffer.lookupVelocityFullCore("body", "world", "world", (1.0, 2.0), "body", at(3.0), second)
