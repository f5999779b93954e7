# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses at keyframes, as a SLAM exports them, correct what a buffer says of the past."""

import copy
import functools
import math
import random
import threading
import time
from contextlib import suppress
from pathlib import PosixPath

import numpy as np
import pytest
import random_runs
from buffer_beside_model import GOOD_PLACES, GOOD_TURNS, Pair, place, same_rotation
from messages_with_or_without_ros import Duration
from model_math import composed, inverse
from model_terms import ModelError
from numpy.testing import assert_allclose
from pickles_and_copies import image_of
from times_and_transforms import S, about_z, transform

from tf2_py import BufferCore, ExtrapolationException, InvalidArgumentException, LookupException
from tf2_py._objects import log
from tf2_ros import correction
from tf2_ros.correction import AUTHORITY, correct
from tf2_ros.numpy import from_matrix, to_arrays, to_matrix
from tf2_ros.serialization import serialize_arrays

pytestmark = pytest.mark.usefixtures("no_refusals_logged")

EDGE = ("map", "odom", "base")


def planar(x, y, angle):
    return to_matrix(transform("", "", 0, (x, y, 0.3), about_z(angle)))


# A drive of 30 s: the truth, and the odometry, whose frame drifts and turns in the map.

ODOMETRY_NS = np.arange(S, 31 * S, S // 50)
KEYFRAMES_NS = np.arange(3 * S, 28 * S, S // 2)


def truth(ns):
    s = ns / S
    return planar(10 * math.sin(s / 7), 8 * math.cos(s / 5), 0.9 * math.sin(s))


def drift(ns):
    s = ns / S
    return planar(0.1 * s + 0.2 * math.sin(s / 3), -0.05 * s, 0.02 * math.sin(s / 4) + 0.004 * s)


def drive(cache_s=100.0):
    """A buffer in which the odometry is taken for the truth."""
    return copy.copy(_drive(cache_s))


@functools.cache
def _drive(cache_s):
    buffer = BufferCore(Duration(seconds=cache_s))
    for ns in ODOMETRY_NS.tolist():
        measured = np.linalg.inv(drift(ns)) @ truth(ns)
        one = from_matrix(measured, child_frame_id="base")
        one.header.frame_id, one.header.stamp = "odom", transform("", "", ns=ns).header.stamp
        buffer.set_transform(one, "wheels")
        if ns % S == 0:
            buffer.set_transform(transform("map", "odom", ns=ns), "slam")
    return buffer


def poses_at(times):
    return np.array([truth(ns) for ns in times.tolist()])


def errors(buffer, times):
    """How far the robot is from the truth, in meters; and how far its rotation."""
    difference = np.abs(buffer.lookup_matrices("map", "base", times) - poses_at(times))
    return difference[:, :3, 3].max(), difference[:, :3, :3].max()


def between(first_ns, last_ns):
    return ODOMETRY_NS[(ODOMETRY_NS >= first_ns) & (ODOMETRY_NS <= last_ns)]


def test_the_robot_was_where_the_slam_says_with_the_rate_of_the_odometry():
    buffer = drive()
    corrected = between(KEYFRAMES_NS[0], KEYFRAMES_NS[-1])
    assert errors(buffer, corrected)[0] > 1.0
    assert correct(buffer, *EDGE, KEYFRAMES_NS, poses_at(KEYFRAMES_NS)) == len(KEYFRAMES_NS)
    # Linear interpolation over h is off by at most h² / 8 times the second derivative of the drift: of its
    # place, below 0.023 m/s²; of its angle, below 0.0013 rad/s², up to 15 m from the origin of odom.
    place, turn = errors(buffer, corrected)
    assert place < 0.5**2 / 8 * (0.023 + 15 * 0.0013) + 15 * 0.01**2 / 8
    assert turn < 0.5**2 / 8 * 0.0013 + 1e-9
    at_keyframes = errors(buffer, KEYFRAMES_NS)
    assert max(at_keyframes) < 1e-12
    # Poses that are interpolated themselves would be further off.
    alone = BufferCore(Duration(seconds=100.0))
    for pose, ns in zip(poses_at(KEYFRAMES_NS), KEYFRAMES_NS.tolist(), strict=True):
        one = from_matrix(pose, child_frame_id="base")
        one.header.frame_id, one.header.stamp = "map", transform("", "", ns=ns).header.stamp
        alone.set_transform(one, "slam")
    assert errors(alone, corrected)[0] > 10 * place


@pytest.mark.parametrize("before", ["keep", "hold"])
@pytest.mark.parametrize("after", ["keep", "hold"])
def test_what_happens_before_the_first_and_after_the_last_keyframe(before, after):
    buffer, old = drive(), drive()
    correct(buffer, *EDGE, KEYFRAMES_NS, poses_at(KEYFRAMES_NS), before=before, after=after)
    first, last = KEYFRAMES_NS[[0, -1]]
    for how, edge, times in (
        (before, first, between(0, first - S)),
        (after, last, between(last + S, 31 * S)),
    ):
        if how == "hold":
            got = buffer.lookup_matrices("map", "odom", times)
            assert_allclose(got, np.broadcast_to(drift(edge), got.shape), atol=1e-12)
        else:  # up to the last odometry only as far as the map reached
            got, wanted = (
                one.lookup_matrices("map", "odom", times, on_missing="nan") for one in (buffer, old)
            )
            np.testing.assert_array_equal(got, wanted)
    stamps = buffer.histories()["odom"].stamps_ns
    assert stamps[0] == ODOMETRY_NS[0]
    assert stamps[-1] == (ODOMETRY_NS[-1] if after == "hold" else 30 * S)
    assert AUTHORITY in buffer.all_frames_as_yaml()


def test_its_own_poses_change_nothing():
    buffer = drive()
    correct(buffer, *EDGE, KEYFRAMES_NS, poses_at(KEYFRAMES_NS), before="hold", after="hold")
    every = ODOMETRY_NS + 7
    old = buffer.lookup_matrices("map", "base", every[:-1])
    stamps = buffer.histories()["odom"].stamps_ns.tolist()
    own = buffer.lookup_matrices("map", "base", stamps)
    for before, after in (("keep", "keep"), ("hold", "hold")):
        for poses in (own, buffer.lookup_transforms("map", "base", stamps)):
            assert correct(buffer, *EDGE, stamps, poses, before=before, after=after) == len(stamps)
            assert_allclose(buffer.lookup_matrices("map", "base", every[:-1]), old, rtol=0, atol=1e-12)
            assert buffer.histories()["odom"].stamps_ns.tolist() == stamps


def test_two_corrections_end_where_the_second_one_does():
    buffer, once = drive(), drive()
    wrong = poses_at(KEYFRAMES_NS) @ planar(1, 2, 0.5)
    correct(buffer, *EDGE, KEYFRAMES_NS, wrong)
    for one in (buffer, once):
        correct(one, *EDGE, KEYFRAMES_NS, poses_at(KEYFRAMES_NS))
    got, wanted = (one.lookup_matrices("map", "base", ODOMETRY_NS) for one in (buffer, once))
    assert_allclose(got, wanted, rtol=0, atol=1e-12)


def test_there_need_not_be_a_map_before():
    buffer = drive()
    buffer.forget("odom")
    correct(buffer, *EDGE, KEYFRAMES_NS, poses_at(KEYFRAMES_NS))
    assert buffer.time_range("map", "base") == (KEYFRAMES_NS[0], ODOMETRY_NS[-1])
    assert errors(buffer, KEYFRAMES_NS)[0] < 1e-12


def test_the_corrected_frame_may_be_the_moving_one():
    buffer = drive()
    buffer.forget("odom")
    assert correct(buffer, "map", "odom", "odom", [S, 2 * S], poses_at(np.array([S, 2 * S]))) == 2
    assert_allclose(
        buffer.lookup_matrices("map", "odom", [S, 2 * S]), poses_at(np.array([S, 2 * S])), atol=1e-12
    )


# Keyframes that cannot be used.


def test_a_keyframe_without_odometry_raises_with_its_index_or_is_skipped():
    buffer, times = drive(), np.array([3 * S, 40 * S, 5 * S, S // 2])
    before = image_of(buffer)
    with pytest.raises(ExtrapolationException, match=r"^times\[1\]: .*future"):
        correct(buffer, *EDGE, times, poses_at(times))
    assert image_of(buffer) == before
    assert correct(buffer, *EDGE, times, poses_at(times), on_missing="skip") == 2
    assert errors(buffer, times[[0, 2]])[0] < 1e-12
    assert correct(buffer, *EDGE, times[[1, 3]], poses_at(times[[1, 3]]), on_missing="skip") == 0


def test_a_keyframe_that_the_buffer_would_not_keep_does_so_too():
    buffer = drive(cache_s=10.0)
    buffer.set_transform(transform("map", "odom", 32), "slam")  # dated ahead, as localizers do
    times = np.array([21 * S + 1, 25 * S])
    with pytest.raises(ValueError, match=r"times\[0\]: 21.000000001 s is more than cache_time, 10.0"):
        correct(buffer, *EDGE, times, poses_at(times))
    assert correct(buffer, *EDGE, times, poses_at(times), on_missing="skip", before="hold") == 1
    assert buffer.histories()["odom"].stamps_ns.tolist() == [22 * S, 25 * S, 32 * S]
    oldest = np.array([22 * S, 25 * S])
    assert correct(buffer, *EDGE, oldest, poses_at(oldest)) == 2


def test_odometry_makes_a_keyframe_too_old_only_where_the_correction_is_held_up_to_it():
    buffer, times = BufferCore(Duration(seconds=10)), np.array([14 * S, 13 * S, 15 * S])
    for child, parent, seconds in (("odom", "map", (10, 12)), ("base", "odom", range(10, 25))):
        for s in seconds:  # SLAM is behind
            buffer.set_transform(transform(parent, child, s), "x")
    with pytest.raises(
        ValueError, match=r"times\[1\]: 13.0* s is more than cache_time, 10.0* s, before 24.0* s"
    ):
        correct(buffer, *EDGE, times, poses_at(times))
    assert correct(buffer, *EDGE, times, poses_at(times), after="keep") == 3


def test_a_keyframe_at_0_has_no_odometry_because_that_means_the_latest():
    buffer, times = drive(), np.array([S, 0])
    with pytest.raises(ValueError, match=r"times\[1\]: expected a time above 0"):
        correct(buffer, *EDGE, times, poses_at(times))
    assert correct(buffer, *EDGE, times, poses_at(times), on_missing="skip") == 1


def test_no_keyframes_change_nothing():
    assert correct(drive(), *EDGE, [], np.empty((0, 4, 4))) == 0


WRONG = {
    "expected a Buffer or BufferCore, got int": (TypeError, {"buffer": 3}),
    "parent: expected a str, the name of a frame, got PosixPath": (TypeError, {"parent": PosixPath("map")}),
    "child: expected a str, the name of a frame, got bytes": (TypeError, {"child": b"odom"}),
    "moving: expected a str, the name of a frame, got NoneType": (TypeError, {"moving": None}),
    "before: expected 'keep' or 'hold', got 'drop'": (ValueError, {"before": "drop"}),
    "after: expected 'keep' or 'hold', got None": (ValueError, {"after": None}),
    "on_missing: expected 'raise' or 'skip', got 'nan'": (ValueError, {"on_missing": "nan"}),
    "poses: expected one for each of the 1 times": (ValueError, {"times": [S]}),
    r"poses\[1\]: expected finite numbers": (ValueError, {"poses": np.full((2, 4, 4), np.nan)}),
    "child: 'lidar' is static, so it has no past that could be corrected$": (
        ValueError,
        {"child": "lidar", "moving": "lidar"},
    ),
    "below 'base', and not over 'map', got 'odom'; the path between them at times": (
        ValueError,
        {"child": "base", "moving": "odom"},
    ),
    "not over 'base', got 'base'": (ValueError, {"parent": "base"}),
    "does not exist": (LookupException, {"moving": "nobody"}),
    "child: 'nobody' does not exist": (LookupException, {"child": "nobody", "moving": "nobody"}),
    "parent: expected a frame that is not below 'odom', got 'lidar'": (ValueError, {"parent": "lidar"}),
    "not over 'base', got 'lidar'": (ValueError, {"parent": "/base", "moving": "lidar"}),
    r"times\[1\]: expected a time above 0, got -0\.000000001 s": (ValueError, {"times": [S, -1]}),
    r"times\[0\]: the time 9000000000\.000000000 s does not fit into the stamp of a message": (
        OverflowError,
        {"times": [9 * 10**18, S]},
    ),
    "parent: expected the name of a frame, got ''": (InvalidArgumentException, {"parent": ""}),
    "parent: expected the name of a frame, got '//map'": (InvalidArgumentException, {"parent": "//map"}),
    "child: expected the name of a frame, got '/'": (InvalidArgumentException, {"child": "/"}),
    "moving: expected the name of a frame, got '//b'": (InvalidArgumentException, {"moving": "//b"}),
}


def test_poses_in_another_frame_are_refused():
    buffer, before = drive(), drive()
    times = np.array([3 * S, 5 * S])
    stamped = [from_matrix(pose, child_frame_id="base") for pose in poses_at(times)]
    stamped[1].header.frame_id = "odom"
    for poses in (iter(stamped), np.array(stamped)):
        with pytest.raises(ValueError, match=r"poses\[1\]: expected a pose in 'map', got one in 'odom'"):
            correct(buffer, *EDGE, times, poses)
    assert image_of(buffer) == image_of(before)
    stamped[1].header.frame_id = "/map"
    assert correct(buffer, *EDGE, times, iter(stamped)) == 2
    assert max(errors(buffer, times)) < 1e-12


def test_equal_keyframes_are_one_if_their_poses_agree():
    buffer, once = drive(), drive()
    times = np.array([5 * S, 3 * S, 5 * S, 3 * S, 7 * S, 5 * S])
    poses = poses_at(times)
    poses[[2, 3], 0, 3] += [9e-10, -9e-10]
    translations, rotations = to_arrays(poses)
    for given in (poses, (translations, rotations * np.array([[1], [1], [-1], [1], [1], [-1]]))):
        for before in ("keep", "hold"):
            for on_missing in ("raise", "skip"):
                how = {"before": before, "on_missing": on_missing}
                assert correct(buffer, *EDGE, times, given, **how) == 3
                assert correct(once, *EDGE, [3 * S, 5 * S, 7 * S], poses_at(times[[1, 0, 4]]), **how) == 3
                got, wanted = (one.histories()["odom"] for one in (buffer, once))
                assert got.stamps_ns.tolist() == wanted.stamps_ns.tolist()
                assert_allclose(got.translations, wanted.translations, rtol=0, atol=1e-12)


def test_equal_keyframes_whose_poses_differ_are_refused_or_all_left_out():
    wrong = {
        "2e-09 m and 0 degrees": planar(2e-9, 0, 0.0),
        "0 m and 1.15e-07 degrees": planar(0, 0, 2e-9),
        "1.9 m and 180 degrees": planar(1.9, 0, math.pi),
    }
    for apart, other in wrong.items():
        buffer, before, times = drive(), drive(), np.array([5 * S, 3 * S, 7 * S, 3 * S, 3 * S])
        poses = poses_at(times)
        poses[3] = poses[3] @ np.linalg.inv(planar(0, 0, 0)) @ other
        text = rf"times\[1\] and times\[3\] are both 3.000000000 s, but their poses are {apart} apart"
        with pytest.raises(ValueError, match=text):
            correct(buffer, *EDGE, times, poses)
        assert image_of(buffer) == image_of(before)
        assert correct(buffer, *EDGE, times, poses, on_missing="skip", before="hold") == 2
        assert correct(before, *EDGE, times[[0, 2]], poses[[0, 2]], before="hold") == 2
        assert image_of(buffer) == image_of(before)
        assert correct(buffer, *EDGE, times[[1, 3]], poses[[1, 3]], on_missing="skip") == 0


def test_samples_that_the_buffer_refuses_for_good_raise_and_change_nothing():
    buffer = BufferCore(Duration(seconds=100), max_frames=2)
    for s in (1, 2):
        buffer.set_transform(transform("odom", "base", s, (s, 0, 0)), "wheels")
    before = image_of(buffer)
    with pytest.raises(ValueError, match="the buffer refused the samples of 'odom' in 'map'"):
        correct(buffer, *EDGE, [S, 2 * S], poses_at(np.array([S, 2 * S])))
    assert image_of(buffer) == before


def test_names_of_frames_are_stored_without_their_leading_slash():
    buffer, other = drive(), drive()
    for one, edge in ((buffer, ("/map", "/odom", "/base")), (other, EDGE)):
        assert correct(one, *edge, KEYFRAMES_NS, poses_at(KEYFRAMES_NS)) == len(KEYFRAMES_NS)
    assert image_of(buffer) == image_of(other)


def test_the_way_out_of_a_static_child_is_a_new_frame_above_its_parent():
    buffer = drive()
    buffer.forget("odom")
    buffer.set_transform_static(transform("map", "odom", xyz=(1, 0, 0)), "tf_static")
    poses = poses_at(KEYFRAMES_NS)
    with pytest.raises(ValueError, match="pass 'map' as child and a new frame, such as 'world', as parent$"):
        correct(buffer, *EDGE, KEYFRAMES_NS, poses)
    assert correct(buffer, "world", "map", "base", KEYFRAMES_NS, poses) == len(KEYFRAMES_NS)
    assert_allclose(buffer.lookup_matrices("world", "base", KEYFRAMES_NS), poses, rtol=0, atol=1e-9)


def test_a_moving_frame_that_hung_elsewhere_at_a_keyframe_is_refused():
    buffer, before = BufferCore(Duration(seconds=100)), BufferCore(Duration(seconds=100))
    for one in buffer, before:
        for s in range(1, 7):
            one.set_transform(transform("map", "odom", s, (100, 0, 0)), "x")
            one.set_transform(transform("map" if s < 3 else "odom", "base", s, (s, 0, 0)), "x")
    times = np.array([S, 2 * S, 4 * S])
    with pytest.raises(ValueError, match=r"not over 'map', got 'base'; the path between them at times\[0\]"):
        correct(buffer, *EDGE, times, poses_at(times))
    assert buffer.histories()["odom"].stamps_ns.tolist() == before.histories()["odom"].stamps_ns.tolist()


@pytest.mark.parametrize("text", WRONG)
def test_wrong_arguments_are_refused_and_change_nothing(text):
    buffer, (kind, wrong) = drive(), WRONG[text]
    buffer.set_transform_static(transform("base", "lidar"), "urdf")
    before = image_of(buffer)
    poses = poses_at(np.array([S, 2 * S]))
    if np.isnan(wrong.get("poses", poses)).any():
        wrong = {"poses": np.array([poses[0], wrong["poses"][0]])}
    given = {"buffer": buffer, "parent": "map", "child": "odom", "moving": "base", "times": [S, 2 * S]}
    with pytest.raises(kind, match=text):
        correct(**given | {"poses": poses} | wrong)
    assert image_of(buffer) == before


# Beside the model.


def ranges(model):
    """The times from the first to the last stamp of `b`, and those at which `d` in `b` is known."""
    stamps = [one[0] for one in model.frames["b"].samples]
    found = [(stamps[0], stamps[-1])]
    with suppress(ModelError):
        found.append(model.time_range("b", "d"))
    return found


def hold(model, samples, cache_ns, before, after):
    """Drop the samples that a buffer would not keep, and add those at the ends of what is held."""
    begins, ends = zip(*ranges(model), strict=True)
    newest_ns = max(*samples, *(ends if after == "hold" else ends[:1]))
    begin_ns = max(min(*samples, *begins), newest_ns - cache_ns)
    for ns in [ns for ns in samples if ns < begin_ns]:
        del samples[ns]
    used = len(samples)
    if used and before == "hold":
        samples.setdefault(begin_ns, samples[min(samples)])
    if used and after == "hold":
        samples.setdefault(newest_ns, samples[max(samples)])
    return used


@pytest.mark.parametrize("before", ["keep", "hold"])
@pytest.mark.parametrize("after", ["keep", "hold"])
@pytest.mark.parametrize("seed", range(40))
def test_random_buffers_hold_what_the_definition_says(seed, before, after):
    """Of small trees with gaps, several parents, one sample and none; the lookups are those of the model."""
    dice, pair = random.Random(f"{seed} {before} {after}"), Pair()
    cache_ns = dice.choice((2**40, 30, 15))
    pair.init(cache_ns)
    for child, parents, count in (("b", "a", 12), ("c", "bbbx", 20), ("d", "c", dice.choice((1, 3, 15)))):
        end_ns = dice.choice((30, 60)) if child == "b" else 60  # SLAM may be behind
        for ns in sorted(dice.sample(range(1, end_ns), count)):
            link = dice.choice(parents), child, ns, dice.randrange(GOOD_PLACES), dice.randrange(GOOD_TURNS)
            pair.insert("set", (link,), "x")
    times = dice.sample(range(1, 64), k=dice.choice((2, 6)))
    for i in range(dice.randrange(3)):  # keyframes at the ends of the data
        times[i] = dice.choice(dice.choice(ranges(pair.model)))
    poses = [(place(dice.randrange(GOOD_PLACES)), about_z(dice.random())) for _ in times]
    for i in dice.choices(range(len(times)), k=2):
        times.append(times[i])
        poses.append(dice.choice(poses[i : i + 2]))
    samples = {}
    for ns, pose in zip(times, poses, strict=True):
        if any(ns == other and pose != its for other, its in zip(times, poses, strict=True)):
            continue
        with suppress(ModelError):
            odometry = pair.model.lookup("b", "d", ns)[3:]
            samples[ns] = composed(pose, inverse(odometry))
    messages = [transform("", "", 0, *pose) for pose in poses]
    how = {"before": before, "after": after, "on_missing": "skip"}
    used = correct(pair.buffer, "a", "b", "d", times, messages, **how)
    assert used == (hold(pair.model, samples, cache_ns, before, after) if samples else 0)
    pair.model.replace([("a", "b", ns, *one) for ns, one in sorted(samples.items())], AUTHORITY)
    held, wanted = pair.buffer.histories()["b"], pair.model.frames["b"].samples
    assert held.stamps_ns.tolist() == [one[0] for one in wanted]
    assert_allclose(held.translations, [one[2] for one in wanted], rtol=0, atol=1e-9)
    assert all(map(same_rotation, held.rotations.tolist(), [one[3] for one in wanted]))


@pytest.mark.parametrize(
    ("on_missing", "first_ns", "held_ns"),
    [("skip", 3 * S, [21_900_000_000, 22 * S]), ("raise", 21_800_000_000, [21_800_000_000, 22_300_000_000])],
)
def test_each_try_leaves_more_room_for_transforms_that_arrive_meanwhile(
    monkeypatch, on_missing, first_ns, held_ns
):
    """As with so many keyframes that a few transforms arrive between reading and writing, in each try."""
    buffer, tries = drive(cache_s=10.0), []

    def write_late(*arguments):
        tries.append(newest_ns := 31 * S + len(tries) * S // 4)
        for parent, child in (("map", "odom"), ("odom", "base")):
            buffer.set_transform(transform(parent, child, ns=newest_ns), "x")
        return serialize_arrays(*arguments)

    monkeypatch.setattr(correction, "serialize_arrays", write_late)
    times = np.arange(first_ns, 28 * S, S // 2)
    assert correct(buffer, *EDGE, times, poses_at(times), before="hold", on_missing=on_missing) > 0
    # The last one reads up to 31.5 s, leaves 0.4 s of room, and writes when the oldest stamp is 21.75 s.
    assert len(tries) == 4
    assert buffer.histories()["odom"].stamps_ns[:2].tolist() == held_ns


@pytest.mark.repeated
def test_it_succeeds_while_later_transforms_make_the_oldest_ones_too_old(monkeypatch):
    """A thread inserts between reading and writing, so that the first try is refused now and then."""
    buffer, begun, ended = BufferCore(Duration(seconds=0.3)), threading.Event(), threading.Event()
    logged, longest_ns = [], 0
    monkeypatch.setattr(log, "refused", lambda *line: logged.append(line))

    def refused_together():
        return buffer.statistics()["refused"]["replaced_together"]

    def drive_on():
        nonlocal longest_ns
        start_ns = last_ns = time.monotonic_ns()
        while not ended.is_set():
            ns = time.monotonic_ns()
            longest_ns, last_ns = max(longest_ns, ns - last_ns), ns
            buffer.set_transform(transform("odom", "base", ns=ns), "wheels")
            buffer.set_transform(transform("map", "odom", ns=ns), "slam")
            if ns - start_ns > 0.3 * S:
                begun.set()

    thread = threading.Thread(target=drive_on)
    thread.start()
    try:
        assert begun.wait(60)
        left, deadline = random_runs.times(100, 1000), time.monotonic() + 60
        # On a busy machine, the thread may insert nothing between reading and writing for long.
        while left > 0 or (not refused_together() and time.monotonic() < deadline):
            left -= 1
            times = np.arange(time.monotonic_ns() - S, time.monotonic_ns(), S // 200)
            poses = np.tile(planar(1, 2, 0.5), (len(times), 1, 1))
            used = correct(buffer, *EDGE, times, poses, before="hold", on_missing="skip")
            # On a busy machine, either thread may rest for as long as the buffer keeps anything.
            assert used > 0 or max(longest_ns, time.monotonic_ns() - times[-1]) > 0.2 * S
    finally:
        ended.set()
        thread.join()
    assert refused_together() > 0
    assert logged == []  # these tries are repeated
    buffer._self_check()
