"""Lookups that accept more than tf2's: a tolerance, extrapolation, a longest gap."""

import asyncio

import numpy as np
import pytest
from making import S, at_ns, rotation, stamp_ns, transform, translation
from ros_optional import Duration
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.ours

POLICIES = [
    {"tolerance": 0.3},
    {"tolerance": 0.3, "extrapolate": True},
    {"max_gap": 0.3},
    {"tolerance": 0.5, "extrapolate": True, "max_gap": 0.3},
]


@pytest.mark.parametrize("policy", POLICIES, ids=str)
def test_many_times_and_frames_are_answered_as_each_alone(tf2_ros, policy):
    """What the answers are says the model (test_model.py)."""
    numbers, buffer, counts = np.random.default_rng(3), tf2_ros.Buffer(1000), [0, 0]
    for parent, child in (("map", "odom"), ("odom", "base"), ("base", "arm")):
        stamps = S + np.cumsum(numbers.integers(50_000_000, 400_000_000, 60))
        turns = Rotation.random(60, random_state=4).as_quat()
        for stamp, place, turn in zip(stamps, numbers.normal(size=(60, 3)), turns, strict=True):
            buffer.set_transform(transform(parent, child, ns=int(stamp), xyz=place, xyzw=turn), "x")
    times = [*map(int, stamps), *map(int, numbers.integers(S, stamps[-1] + S, 500))]
    sources = ["arm", "map", "base"]
    places, turns = buffer.lookup_transforms("odom", sources, times, on_missing="nan", **policy)
    for i, source in enumerate(sources):
        for time, place, turn in zip(times, places[i], turns[i], strict=True):
            try:
                answer = buffer.lookup_transform("odom", source, at_ns(time), **policy)
            except tf2_ros.ExtrapolationException:
                assert np.isnan((*place, *turn)).all()
            else:
                assert (*translation(answer), *rotation(answer)) == (*place, *turn)
            counts[int(np.isnan(place[0]))] += 1
    assert min(counts) > 10


@pytest.mark.parametrize("tolerance", [0.5, Duration(seconds=0.5)], ids=["seconds", "Duration"])
def test_the_end_of_a_tolerance_belongs_to_it(tf2_ros, tolerance):
    buffer = tf2_ros.Buffer()
    buffer.set_transform(transform("map", "base", 2, (2, 0, 0)), "x")
    answer = buffer.lookup_transform("map", "base", at_ns(2 * S + S // 2), tolerance=tolerance)
    assert (stamp_ns(answer), translation(answer)) == (2 * S, (2, 0, 0))
    with pytest.raises(tf2_ros.ExtrapolationException, match="only time 2.000000000 is in the buffer"):
        buffer.lookup_transform("map", "base", at_ns(2 * S + S // 2 + 1), tolerance=tolerance)


def test_a_gap_that_is_too_long_is_described(tf2_ros):
    buffer = tf2_ros.Buffer()
    for second in (2, 4):
        buffer.set_transform(transform("map", "base", second), "x")
    with pytest.raises(tf2_ros.ExtrapolationException) as raised:
        buffer.lookup_transform("map", "base", at_ns(3 * S), max_gap=1)
    assert str(raised.value) == (
        "Lookup at time 3.000000000 would require interpolation across 2.000000000 s, when looking up "
        "transform from frame [base] to frame [map]; the samples of base at 2.000000000 and "
        "4.000000000 are further apart than max_gap, 1.000000000 s"
    )
    with pytest.raises(tf2_ros.ExtrapolationException, match=r"^times\[1\]: Lookup at time 3"):
        buffer.lookup_transforms("map", "base", [2 * S, 3 * S], max_gap=1)


LATE = at_ns(5 * S // 2)
WAYS = {
    "lookup_transform": lambda b, **p: b.lookup_transform("map", "base", LATE, **p),
    "with a timeout": lambda b, **p: b.lookup_transform("map", "base", LATE, 0.001, **p),
    "full": lambda b, **p: b.lookup_transform_full("map", LATE, "base", LATE, "odom", **p),
    "full, with a timeout": lambda b, **p: b.lookup_transform_full(
        "map", LATE, "base", LATE, "odom", 1e-3, **p
    ),
    "async": lambda b, **p: asyncio.run(b.lookup_transform_async("map", "base", LATE, timeout=0.01, **p)),
    "full async": lambda b, **p: asyncio.run(
        b.lookup_transform_full_async("map", LATE, "base", LATE, "odom", timeout=0.01, **p)
    ),
    "transform": lambda b, **p: b.transform(transform("base", "data", 2.5), "map", **p),
    "transform_full": lambda b, **p: b.transform_full(
        transform("base", "data", 2.5), "map", LATE, "odom", **p
    ),
    "transform_async": lambda b, **p: asyncio.run(
        b.transform_async(transform("base", "data", 2.5), "map", timeout=0.01, **p)
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_every_way_to_look_up_takes_a_policy(tf2_ros, way):
    pytest.importorskip("tf2_geometry_msgs")
    buffer = tf2_ros.Buffer()
    for second in (1, 2):
        buffer.set_transform(transform("map", "odom", second, (0, 1, 0)), "x")
        buffer.set_transform(transform("odom", "base", second, (second, 0, 0)), "x")
    with pytest.raises(tf2_ros.TransformException):
        WAYS[way](buffer)
    answer = WAYS[way](buffer, tolerance=0.5, extrapolate=True)
    assert translation(answer) == (2.5, 1, 0)
    assert stamp_ns(answer) == LATE.nanoseconds


def test_questions_and_points_take_a_policy(tf2_ros):
    buffer = tf2_ros.Buffer()
    for second in (1, 2):
        buffer.set_transform(transform("map", "base", second, (second, 0, 0)), "x")
    for ask in (
        lambda **p: buffer.can_transform("map", "base", LATE, return_debug_tuple=True, **p),
        lambda **p: buffer.can_transform("map", "base", LATE, 0.001, return_debug_tuple=True, **p),
        lambda **p: buffer.can_transform_full("map", LATE, "base", LATE, "map", 0, True, **p),
    ):
        assert ask(tolerance=0.5) == (True, "")
        can, reason = ask(tolerance=0.4)
        assert not can
        assert "into the future" in reason
    moved = buffer.transform_points([(0, 0, 1)], [LATE], "map", "base", tolerance=1, extrapolate=True)
    assert moved.tolist() == [[2.5, 0, 1]]
    with pytest.raises(TypeError, match=r"^transform_points.*Did you mean 'max_gap'"):
        buffer.transform_points([(0, 0, 1)], [LATE], "map", "base", maxgap=1)


class TestArguments:
    @pytest.mark.parametrize(
        ("policy", "error", "text"),
        [
            ({"tolerance": -1}, ValueError, "must not be negative"),
            ({"tolerance": float("nan")}, ValueError, "NaN"),
            ({"tolerance": "1"}, TypeError, "tolerance"),
            ({"max_gap": -0.1}, ValueError, "must not be negative"),
            ({"extrapolate": True}, TypeError, "needs a tolerance"),
        ],
        ids=str,
    )
    def test_wrong_ones_are_refused_everywhere(self, tf2_ros, policy, error, text):
        buffer = tf2_ros.Buffer()
        buffer.set_transform(transform("map", "base", 1), "x")
        for look_up in (buffer.lookup_transform, buffer.lookup_transforms):
            with pytest.raises(error, match=text):
                look_up("map", "base", [S] if look_up == buffer.lookup_transforms else at_ns(S), **policy)

    @pytest.mark.parametrize(
        ("name", "meant"),
        [("tolerence", "tolerance"), ("maxgap", "max_gap"), ("time_out", "timeout"), ("colour", None)],
    )
    def test_a_misspelt_one_is_named_with_the_method(self, tf2_ros, name, meant):
        buffer = tf2_ros.Buffer()
        given = ("map", "base", at_ns(S))
        asked = "" if meant is None else rf"\. Did you mean '{meant}'\?"
        for call, run in (
            ("lookup_transform", lambda: buffer.lookup_transform(*given, **{name: 1})),
            ("lookup_transform", lambda: buffer.lookup_transform(*given, timeout=1, **{name: 1})),
            ("wait_for_transform_async", lambda: buffer.wait_for_transform_async(*given, **{name: 1})),
            (
                "lookup_transform_async",
                lambda: asyncio.run(buffer.lookup_transform_async(*given, **{name: 1})),
            ),
        ):
            with pytest.raises(
                TypeError, match=rf"^{call}\(\) got an unexpected keyword .* '{name}'{asked}$"
            ):
                run()
