"""Twists against motions whose derivatives are known."""

import itertools

import numpy as np
import pytest
from making import S, at, at_ns, transform
from ros_optional import Duration
from scipy.spatial.transform import Rotation

from tf2_py import TransformException

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
    # The body turns evenly about its moving origin; the sensor sits on it.
    buffer = tf2_py.BufferCore(Duration(seconds=100))
    record(buffer, "world", "body", lambda t: (V * t, Rotation.from_rotvec(OMEGA * t)))
    buffer.set_transform_static(transform("body", "sensor", xyz=(1, 2, 3)), "x")
    return buffer


def assert_twist(got, linear, angular, tolerance=1e-6):
    np.testing.assert_allclose(got[0], linear, atol=tolerance)
    np.testing.assert_allclose(got[1], angular, atol=tolerance)


def test_times_are_exact_to_the_nanosecond(tf2_py):
    buffer = tf2_py.BufferCore(Duration(seconds=100))
    start = 1_700_000_000 * 10**9
    for i in range(3):
        buffer.set_transform(transform("world", "body", ns=start + i * 1000, xyz=(i * 1e-6, 0, 0)), "x")
    (vx, _, _), _ = buffer.lookupVelocityCore(
        "body", "world", at_ns(start + 1000), Duration(nanoseconds=2000)
    )
    assert vx == pytest.approx(1.0, rel=1e-9)


def test_wrong_arguments(buffer):
    second = Duration(seconds=1)
    with pytest.raises(ValueError, match="negative"):
        buffer.lookupVelocityCore("body", "world", at(3.0), Duration(seconds=-1))
    with pytest.raises((TypeError, ValueError)):
        buffer.lookupVelocityFullCore("body", "world", "world", (1.0, 2.0), "body", at(3.0), second)


@pytest.fixture(scope="module")
def robot(tf2_py):
    """Frames with stamps of their own, and turns of up to two radians between samples."""
    random = np.random.default_rng(7)
    buffer = tf2_py.BufferCore(Duration(seconds=1000))
    for parent, child in (("world", "body"), ("body", "arm"), ("arm", "hand")):
        stamps = S + np.cumsum(random.integers(1_000_000, 30_000_000, 200))
        turns = Rotation.from_rotvec(random.normal(size=(200, 3))).as_quat()
        for ns, turn in zip(stamps, turns, strict=True):
            buffer.set_transform(
                transform(parent, child, ns=int(ns), xyz=random.normal(size=3), xyzw=turn), "x"
            )
    buffer.set_transform_static(transform("body", "sensor", xyz=(1, 2, 3), xyzw=(1, 2, 3, 4)), "x")
    return buffer


class TestAtManyTimes:
    """``lookup_velocities``: one row for each time."""

    FRAMES = ("world", "body", "arm", "hand", "sensor")

    def missing_rows(self, buffer, tracking, observation, times, interval):
        """Each row is that of the single lookup, or NaN where that raises; how many are NaN."""
        got = np.hstack(buffer.lookup_velocities(tracking, observation, times, interval, on_missing="nan"))
        missing = 0
        for row, ns in zip(got, times, strict=True):
            try:
                twist = buffer.lookupVelocityCore(tracking, observation, at_ns(int(ns)), interval)
            except TransformException:
                assert np.isnan(row).all()
                missing += 1
            else:
                np.testing.assert_array_equal(row, np.ravel(twist))
        return missing

    @pytest.mark.parametrize(("tracking", "observation"), [*itertools.permutations(FRAMES, 2)])
    def test_each_row_is_that_of_the_single_lookup(self, robot, tracking, observation):
        newest = robot.get_latest_common_time("world", "hand").nanoseconds
        times = np.concatenate([[0, 1, newest, newest + 1], np.arange(S, newest + S, 17_000_000)])
        moves = {tracking, observation} != {"body", "sensor"}
        for interval in (Duration(nanoseconds=1), Duration(seconds=0.1), Duration(seconds=1000)):
            missing = self.missing_rows(robot, tracking, observation, times, interval)
            assert (missing > 0) == moves
        self.missing_rows(robot, tracking, observation, times, Duration())  # those of the others are NaN, too

    def test_an_even_motion_has_its_constant_twist(self, buffer):
        assert buffer.lookup_velocities("body", "world", [], Duration(seconds=1))[0].shape == (0, 3)
        times = np.linspace(0.1 * S, 10 * S, 300).astype(np.int64)
        linear, angular = buffer.lookup_velocities("body", "world", times, Duration(seconds=0.1))
        assert_twist((linear, angular), np.tile(V, (300, 1)), np.tile(OMEGA, (300, 1)))

    def test_the_first_time_without_an_answer_is_in_the_error(self, buffer, tf2_py):
        times = [3 * S, 4 * S, 12 * S, 13 * S]
        with pytest.raises(tf2_py.ExtrapolationException, match=r"^times\[2\]: .*time 11\.5"):
            buffer.lookup_velocities("body", "world", times, Duration(seconds=1))
        late = tf2_py.BufferCore(Duration(seconds=100))
        late.set_transforms([transform("world", "body", t) for t in (9.5, 10.0, 13.0)], "x")
        with pytest.raises(tf2_py.ExtrapolationException, match=r"^times\[1\]: .*into the past.*time 9\.0"):
            late.lookup_velocities("body", "world", [11 * S, 10 * S], Duration(seconds=2))

    def test_errors_are_those_of_the_single_lookup(self, buffer, tf2_py):
        second = Duration(seconds=1)
        buffer.set_transform_static(transform("island", "hut"), "x")
        for tracking, observation in (
            ("body", "nowhere"),
            ("body", "island"),
            ("body", "/world"),
            ("", "body"),
        ):
            with pytest.raises(tf2_py.TransformException) as single:
                buffer.lookupVelocityCore(tracking, observation, at(3.0), second)
            for on_missing in ("raise", "nan"):
                with pytest.raises(type(single.value)) as error:
                    buffer.lookup_velocities(tracking, observation, [3 * S], second, on_missing=on_missing)
                assert str(error.value) == str(single.value)

    @pytest.mark.parametrize(
        ("arguments", "more", "error", "text"),
        [
            (("body", "world", [1], Duration(nanoseconds=-1)), {}, ValueError, "must not be negative"),
            (("body", "world", [1], "0.5"), {}, TypeError, "averaging_interval"),
            (("body", "world", [0.5], Duration()), {}, TypeError, "integer nanoseconds"),
            (("body", "world", [1], Duration()), {"on_missing": "skip"}, ValueError, "'raise' or 'nan'"),
            ((7, "world", [1], Duration()), {}, TypeError, "expected a str, got int"),
        ],
    )
    def test_wrong_arguments(self, buffer, arguments, more, error, text):
        with pytest.raises(error, match=text):
            buffer.lookup_velocities(*arguments, **more)

    def test_an_interval_that_reaches_beyond_64_bits_ends_at_the_newest_stamp(self, buffer):
        centuries = Duration(nanoseconds=2**63 - 1)
        last = np.iinfo(np.int64).max
        linear, _ = buffer.lookup_velocities("sensor", "body", [last, 5 * S], centuries)
        np.testing.assert_array_equal(linear, np.zeros((2, 3)))
        linear, _ = buffer.lookup_velocities("body", "world", [last], Duration(seconds=1), on_missing="nan")
        assert np.isnan(linear).all()
