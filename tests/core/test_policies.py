"""Lookups that accept more than tf2's: a tolerance, extrapolation, a longest gap."""

import asyncio
import itertools
import random

import numpy as np
import pytest
from making import S, about_z, at_ns, rotation, stamp_ns, transform, translation
from ros_optional import Duration
from scipy.spatial.transform import Rotation, Slerp

pytestmark = pytest.mark.ours

# Each frame, its parent, and how much it turns from sample to sample. The path from hand to mast passes base.
EDGES = [("odom", "map", 0.1), ("base", "odom", 0.4), ("arm", "base", 1.5), ("hand", "arm", 0.02)]
PATHS = {"hand": ["hand", "arm", "base", "odom"], "mast": ["mast", "base", "odom"], "map": []}


class Model:
    """The samples of EDGES, and answers computed with SciPy."""

    def __init__(self, seed):
        numbers = np.random.default_rng(seed)
        self.edges = {}
        for child, parent, step in EDGES:
            count = int(numbers.integers(2, 12))
            stamps = S + np.cumsum(numbers.integers(50_000_000, 400_000_000, count))
            turns = Rotation.from_rotvec(np.cumsum(numbers.normal(scale=step, size=(count, 3)), axis=0))
            self.edges[child] = (parent, stamps, np.cumsum(numbers.normal(size=(count, 3)), axis=0), turns)
        self.mast = (np.array([0.0, 1.0, 2.0]), Rotation.from_quat(about_z(2.5)))

    def fill(self, buffer):
        for child, (parent, stamps, places, turns) in self.edges.items():
            for stamp, place, turn in zip(stamps, places, turns, strict=True):
                buffer.set_transform(
                    transform(parent, child, ns=int(stamp), xyz=place, xyzw=turn.as_quat()), "x"
                )
        buffer.set_transform_static(transform("base", "mast", xyz=(0, 1, 2), xyzw=about_z(2.5)), "x")
        return buffer

    def edge(self, child, time, tolerance=0, extrapolate=False, max_gap=None):
        """Stamp used, place and turn; None: there is no answer."""
        if child == "mast":
            return (time, *self.mast)
        _, stamps, places, turns = self.edges[child]
        late = time - stamps[-1]
        if time < stamps[0] or late > tolerance:
            return None
        if late > 0 and extrapolate:
            ratio = late / (stamps[-1] - stamps[-2])
            turn = (turns[-2].inv() * turns[-1]).as_rotvec()
            return (
                time,
                places[-1] + ratio * (places[-1] - places[-2]),
                turns[-1] * Rotation.from_rotvec(ratio * turn),
            )
        if late >= 0:
            return stamps[-1], places[-1], turns[-1]
        i = int(np.searchsorted(stamps, time, side="right")) - 1
        if stamps[i] == time:
            return time, places[i], turns[i]
        if max_gap is not None and stamps[i + 1] - stamps[i] > max_gap:
            return None
        seconds, now = (stamps - stamps[0]) / S, (time - stamps[0]) / S
        place = [np.interp(now, seconds, places[:, axis]) for axis in range(3)]
        return time, np.array(place), Slerp(seconds[i : i + 2], turns[i : i + 2])(now)

    def answer(self, target, source, time, **policy):
        """Stamp, place and turn of the lookup; None: it has no answer."""
        used, shared = [time], set(PATHS[target]) & set(PATHS[source])
        sides = []
        for frame in (target, source):
            place, turn = np.zeros(3), Rotation.identity()
            for child in PATHS[frame]:
                if child in shared:
                    continue
                hop = self.edge(child, time, **policy)
                if hop is None:
                    return None
                used.append(hop[0])
                place, turn = hop[1] + hop[2].apply(place), hop[2] * turn
            sides.append((place, turn))
        (target_place, target_turn), (place, turn) = sides
        return min(used), target_turn.inv().apply(place - target_place), target_turn.inv() * turn


def matches(message, expected):
    stamp, place, turn = expected
    assert stamp_ns(message) == stamp
    assert translation(message) == pytest.approx(tuple(place), abs=1e-9)
    assert (Rotation.from_quat(rotation(message)) * turn.inv()).magnitude() < 1e-9


POLICIES = [
    {"tolerance": 0.3},
    {"tolerance": 0.3, "extrapolate": True},
    {"max_gap": 0.3},
    {"tolerance": 0.5, "extrapolate": True, "max_gap": 0.3},
]


@pytest.mark.parametrize("policy", POLICIES, ids=str)
@pytest.mark.parametrize(("target", "source"), [*itertools.permutations(PATHS, 2)])
def test_answers_are_those_of_an_independent_computation(tf2_ros, policy, target, source):
    in_ns = {name: round(value * S) for name, value in policy.items() if name in ("tolerance", "max_gap")}
    numbers, counts = random.Random(3), [0, 0]
    for seed in range(12):
        model = Model(seed)
        buffer = model.fill(tf2_ros.Buffer(1000))
        times = [numbers.randrange(S, 4 * S) for _ in range(40)]
        times += [int(stamp) for _, stamps, _, _ in model.edges.values() for stamp in stamps]
        places, turns = buffer.lookup_transforms(target, source, times, on_missing="nan", **policy)
        for time, place, turn in zip(times, places, turns, strict=True):
            expected = model.answer(target, source, time, **(policy | in_ns))
            counts[expected is None] += 1
            if expected is None:
                assert np.isnan(place).all()
                with pytest.raises(tf2_ros.ExtrapolationException):
                    buffer.lookup_transform(target, source, at_ns(time), **policy)
            else:
                answer = buffer.lookup_transform(target, source, at_ns(time), **policy)
                matches(answer, expected)
                assert translation(answer) == tuple(place)
                assert rotation(answer) == tuple(turn)
        together = buffer.lookup_transforms(target, [source, target], times, on_missing="nan", **policy)
        assert np.array_equal(together[0][0], places, equal_nan=True)
        assert np.array_equal(together[1][0], turns, equal_nan=True)
    assert min(counts) > 10


class TestTolerance:
    @pytest.fixture
    def buffer(self, tf2_ros):
        buffer = tf2_ros.Buffer()
        for second in (1, 2):
            buffer.set_transform(transform("map", "base", second, (second, 0, 0)), "x")
        return buffer

    @pytest.mark.parametrize("tolerance", [0.5, Duration(seconds=0.5)], ids=["seconds", "Duration"])
    def test_its_end_belongs_to_it(self, tf2_ros, buffer, tolerance):
        answer = buffer.lookup_transform("map", "base", at_ns(2 * S + S // 2), tolerance=tolerance)
        assert stamp_ns(answer) == 2 * S
        assert translation(answer) == (2, 0, 0)
        with pytest.raises(tf2_ros.ExtrapolationException, match="into the future"):
            buffer.lookup_transform("map", "base", at_ns(2 * S + S // 2 + 1), tolerance=tolerance)

    def test_extrapolating_a_single_sample_or_one_of_a_new_parent_keeps_it(self, tf2_ros, buffer):
        buffer.set_transform(transform("odom", "base", 3, (7, 0, 0)), "x")
        buffer.set_transform(transform("odom", "single", 3, (0, 0, 1)), "x")
        answer = buffer.lookup_transform("single", "base", at_ns(7 * S // 2), tolerance=1, extrapolate=True)
        assert translation(answer) == (7, 0, -1)

    def test_the_parent_is_that_of_the_newest_sample(self, tf2_ros, buffer):
        buffer.set_transform(transform("odom", "base", 3, (7, 0, 0)), "x")
        late = at_ns(7 * S // 2)
        assert translation(buffer.lookup_transform("odom", "base", late, tolerance=1)) == (7, 0, 0)
        with pytest.raises(tf2_ros.TransformException):
            buffer.lookup_transform("map", "base", late, tolerance=1)


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


class TestMaxGap:
    def test_its_length_belongs_to_it_and_samples_need_no_neighbour(self, tf2_ros):
        buffer = tf2_ros.Buffer()
        for second in (1, 2, 4):
            buffer.set_transform(transform("map", "base", second), "x")
        buffer.lookup_transform("map", "base", at_ns(3 * S // 2), max_gap=1)
        buffer.lookup_transform("map", "base", at_ns(4 * S), max_gap=1)
        buffer.lookup_transform("map", "base", at_ns(0), max_gap=1)
        with pytest.raises(tf2_ros.ExtrapolationException) as raised:
            buffer.lookup_transform("map", "base", at_ns(3 * S), max_gap=1)
        assert str(raised.value) == (
            "Lookup at time 3.000000000 would require interpolation across 2.000000000 s, when looking up "
            "transform from frame [base] to frame [map]; the samples of base at 2.000000000 and "
            "4.000000000 are further apart than max_gap, 1.000000000 s"
        )
        with pytest.raises(tf2_ros.ExtrapolationException, match=r"^times\[1\]: Lookup at time 3"):
            buffer.lookup_transforms("map", "base", [S, 3 * S], max_gap=1)

    def test_a_gap_is_one_also_where_the_parent_changes(self, tf2_ros):
        buffer = tf2_ros.Buffer()
        for parent, second in (("map", 1), ("map", 2), ("odom", 4), ("odom", 5)):
            buffer.set_transform(transform(parent, "base", second), "x")
        for parent, time in (("map", 2 * S), ("map", 3 * S), ("odom", 4 * S)):
            buffer.lookup_transform(parent, "base", at_ns(time), max_gap=2)
        for parent, time in (("map", 2 * S), ("odom", 4 * S)):
            buffer.lookup_transform(parent, "base", at_ns(time), max_gap=1)
        text = "base at 2.000000000 and 4.000000000 are further apart than max_gap, 1.000000000 s"
        for look_up, time in ((buffer.lookup_transform, at_ns(3 * S)), (buffer.lookup_transforms, [3 * S])):
            with pytest.raises(tf2_ros.ExtrapolationException, match=text):
                look_up("map", "base", time, max_gap=1)


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


def test_a_wait_goes_on_while_a_late_sample_may_come(tf2_ros):
    buffer = tf2_ros.Buffer(10.0)
    for second in (20, 21):
        buffer.set_transform(transform("map", "base", second), "x")
    answers = []
    policy = buffer_policy(max_gap=3)
    wait = buffer._wait("map", "base", at_ns(19 * S), notify=answers.append, policy=policy)
    buffer.set_transform(transform("map", "base", 18), "x")
    assert [stamp_ns(answer) for answer in answers] == [19 * S]
    assert wait.answer is not None


def buffer_policy(**policy):
    from tf2_py._internal import policy_of

    return policy_of("lookup_transform", **policy)
