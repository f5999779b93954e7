# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""`replace=True`: transforms take the place of what their frames had from the first to the last of them."""

import random
import threading

import numpy as np
import pytest
import random_runs
from messages_with_or_without_ros import Duration
from times_and_transforms import S, at, transform, translation

from tf2_py import BufferCore

pytestmark = pytest.mark.usefixtures("no_refusals_logged")


def samples(buffer, child="odom"):
    """The seconds, parent and x of each sample of a frame."""
    buffer._self_check()
    held = buffer.histories()[child]
    xs = held.translations[:, 0].tolist()
    return [(ns / S, *rest) for ns, *rest in zip(held.stamps_ns.tolist(), held.parents, xs, strict=True)]


def odom(x, *seconds, parent="map"):
    return [transform(parent, "odom", one, (x, 0, 0)) for one in seconds]


def filled(*seconds, **more):
    buffer = BufferCore(Duration(seconds=100.0), **more)
    buffer.set_transforms(odom(0, *(seconds or range(1, 7))), "odometry")
    return buffer


def replace(buffer, transforms, static=False):
    return buffer.set_transforms(transforms, "slam", static, replace=True)


# The rule, of which test_buffer_beside_model.py asks more.


def test_what_lies_from_the_first_to_the_last_stamp_goes_whatever_its_parent():
    buffer = filled(1, 2, 2.5, 3, 5, 6)
    buffer.set_transforms(odom(0, 4, parent="world"), "other")
    assert replace(buffer, odom(9, 2, 4.5)) == 2
    assert samples(buffer) == [(1, "map", 0), (2, "map", 9), (4.5, "map", 9), (5, "map", 0), (6, "map", 0)]
    assert "slam" in buffer.all_frames_as_yaml()


def test_nothing_is_nothing():
    assert replace(filled(), []) == 0


# Refusals.


def in_ms(x, child, milliseconds):
    return [transform("map", child, one / 1000, (x, 0, 0)) for one in milliseconds]


def test_a_limit_of_bytes_refuses_a_new_frame_but_not_what_needs_no_more_memory():
    buffer = BufferCore(max_bytes=60_000)
    buffer.set_transforms(in_ms(0, "odom", range(500)), "odometry")
    assert replace(buffer, in_ms(9, "base", range(600, 1600))) == 0
    assert replace(buffer, in_ms(9, "odom", range(500))) == 500
    assert [one[2] for one in samples(buffer)] == [9] * 500
    assert buffer.statistics()["bytes"] <= 60_000


def test_where_bytes_end_the_oldest_samples_make_room():
    buffer = BufferCore(max_bytes=60_000)
    buffer.set_transforms(in_ms(0, "odom", range(2000)), "odometry")
    held, displaced = len(samples(buffer)), buffer.statistics()["displaced"]
    assert replace(buffer, in_ms(9, "odom", range(2000, 2100))) == 100
    assert samples(buffer) == [(ms / 1000, "map", 9 if ms >= 2000 else 0) for ms in range(2100 - held, 2100)]
    # Also of the call itself.
    assert replace(buffer, in_ms(5, "odom", [2050 + i / 100 for i in range(4000)])) == 4000
    kept = [*(2050 + i / 100 for i in range(4000)), *range(2090, 2100)][-held:]
    assert samples(buffer) == [(pytest.approx(ms / 1000), "map", 9 if ms >= 2090 else 5) for ms in kept]
    statistics = buffer.statistics()
    assert statistics["displaced"] == displaced + 100 + 4000 - 40
    assert statistics["bytes"] <= 60_000
    buffer._self_check()


def test_a_limit_of_bytes_counts_all_frames_of_a_call():
    buffer = BufferCore(max_bytes=50_000)
    given = [*in_ms(1, "first", range(400)), *in_ms(1, "second", range(400)), *in_ms(1, "third", range(20))]
    assert replace(buffer, given) == 420
    assert buffer.statistics()["bytes"] <= 50_000
    assert set(buffer.histories()) == {"first", "third"}
    buffer._self_check()


def test_names_and_samples_of_a_call_share_the_limit_of_bytes():
    buffer = BufferCore(Duration(seconds=1e9), max_bytes=60_000)
    long = [transform("p", f"n{i}_" + "x" * 1500, ns=1) for i in range(30)]
    buffer.set_transforms([*(transform("p", "a", ns=i) for i in range(600)), *long], "x", replace=True)
    assert buffer.statistics()["bytes"] <= 60_000


def test_a_frame_of_the_other_kind_is_refused_without_names():
    buffer = BufferCore(max_frames=6)
    buffer.set_transform_static(transform("a", "s"), "x")
    buffer.set_transforms([transform(f"p{i}", "s", 1) for i in range(9)], "x", replace=True)
    assert buffer.statistics()["refused"]["other_kind"] == 9
    assert "p0" not in buffer.frames()


def test_a_limit_of_frames_refuses_it():
    buffer = filled(max_frames=2)
    before = samples(buffer)
    assert replace(buffer, [*odom(9, 2), *odom(9, 3, parent="new"), *odom(9, 4)]) == 0
    assert samples(buffer) == before
    assert buffer.statistics()["refused"]["too_many_frames"] == 3


# What is beside it.


@pytest.mark.repeated
def test_who_reads_beside_it_sees_all_of_a_call_or_nothing():
    rounds, stamps = random_runs.times(500, 10_000), [S + i * 10**7 for i in range(40)]
    buffer, ended = BufferCore(), threading.Event()

    def both(x):
        there = [transform("map", "odom", ns=ns, xyz=(x, 0, 0)) for ns in stamps]
        back = [transform("odom", "base", ns=ns, xyz=(-x, 0, 0)) for ns in stamps]
        return [*there, *back]

    calls = [both(x) for x in range(20)]
    replace(buffer, calls[0])
    read, problems = [], []

    def reader(ask):
        try:
            while not ended.is_set():
                ask()
                read.append(1)
        except BaseException as error:
            problems.append(error)

    def one():
        ns = random.choice(stamps[:-1])
        assert translation(buffer.lookup_transform_core("map", "base", ns + 3))[0] == 0.0

    def many():
        places, _ = buffer.lookup_transforms("map", "base", stamps[:-1])
        assert np.all(places == 0.0)
        places, _ = buffer.lookup_transforms("map", "odom", stamps)
        assert np.ptp(places[:, 0]) == 0.0

    def whole():
        held = np.concatenate([one.translations[:, 0] for one in buffer.histories().values()])
        assert held.sum() == 0.0 and len(np.unique(np.abs(held))) == 1

    threads = [threading.Thread(target=reader, args=(ask,)) for ask in (one, many, whole)]
    for thread in threads:
        thread.start()
    try:
        for i in range(rounds):
            assert replace(buffer, calls[i % len(calls)]) == 80
    finally:
        ended.set()
        for thread in threads:
            thread.join()
    assert not problems
    assert read
    buffer._self_check()


def test_a_mapped_history_moves_into_memory_and_its_file_keeps_the_old(tmp_path):
    buffer = filled()
    buffer.freeze(tmp_path / "buffer.tf2")
    opened, other = BufferCore.open(tmp_path / "buffer.tf2"), BufferCore.open(tmp_path / "buffer.tf2")
    replace(opened, odom(9, 2, 3))
    assert [one[2] for one in samples(opened)] == [0, 9, 9, 0, 0, 0]
    assert samples(other) == samples(BufferCore.open(tmp_path / "buffer.tf2")) == samples(buffer)
    assert "frozen" not in opened.__getstate__()


def test_waits_are_judged_once_after_the_whole_call():
    buffer, told = BufferCore(Duration(seconds=10.0)), []
    buffer.set_transforms(odom(1, 1), "odometry")
    wait = buffer._wait("map", "base", at(3), notify=lambda answer, error=None: told.append(answer))
    lost = buffer._wait("map", "odom", at(2), notify=lambda answer, error=None: told.append(answer))
    # One after the other, the first two would answer what the third one prunes.
    given = [*odom(5, 1, 3, 15), *[transform("odom", "base", one) for one in (3, 4)]]
    assert buffer.set_transforms(given, "slam", replace=True) == 2
    assert [wait.take(), lost.take()] == [None, None] and told == []
    assert replace(buffer, [*odom(5, 1, 3)]) == 2
    assert [translation(one)[0] for one in told] == [5.0, 5.0]
