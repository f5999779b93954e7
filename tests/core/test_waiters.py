# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Waiting in the engine: being notified, blocking, and following changes."""

import threading
from functools import partial

import pytest
from cdr_encoder import encode
from messages_with_or_without_ros import Duration
from random_runs import times
from times_and_transforms import S, at, at_ns, stamp_ns, transform

from tf2_py import ExtrapolationException


@pytest.fixture
def buffer(tf2_py):
    return tf2_py.BufferCore(Duration(seconds=10))


def never():
    return False


class Untrue(Exception):
    """One that cannot be asked whether it is true."""

    def __bool__(self):
        raise ValueError


def test_whoever_is_notified_may_wait_insert_and_cancel(buffer):
    seen = []
    waits = []

    def again(message):
        seen.append(message)
        other.cancel()
        waits.append(buffer._wait("map", "odom", at(3), notify=seen.append))
        buffer.set_transform(transform("map", "odom", 4), "x")

    other = buffer._wait("map", "odom", at(2), notify=seen.append)
    waits.append(buffer._wait("map", "odom", at(1), notify=again))
    buffer.set_transform(transform("map", "odom", 1), "x")
    assert [stamp_ns(m) // S for m in seen] == [1, 3]


def test_all_are_notified_whatever_one_of_them_raises_and_cancelling_is_too_late(buffer):
    told = {}

    def notify(number, _):
        told[number] = waits[4].cancel()  # which has its answer, and is then not notified of it
        raise Untrue

    waits = [buffer._wait("a", "b", at(5), notify=partial(notify, number)) for number in range(5)]
    buffer.set_transform(transform("a", "b", 4), "test")
    with pytest.raises(Untrue):
        buffer.set_transform(transform("a", "b", 6), "test")
    assert told == dict.fromkeys(range(4), False)
    assert all(wait.take() is not None for wait in waits)


def test_the_others_are_served_while_one_insert_helps_many(buffer):
    # More than one slice: both threads' inserts and all of their waiters go through each other.
    buffer.set_transform(transform("a", "b", 1), "test")
    buffer.set_transform(transform("a", "c", 1), "test")
    told = {"b": [], "c": []}
    waits = [
        buffer._wait("a", child, at_ns(2 * S + i), notify=told[child].append)
        for i in range(2000)
        for child in told
    ]

    def insert(child):
        buffer.set_transform(transform("a", child, 3), "test")
        assert len(told[child]) == 2000, "an insert returned before those whom it completed were told"

    threads = [threading.Thread(target=insert, args=(child,)) for child in told]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(wait.take() is not None for wait in waits)
    assert {child: len(answers) for child, answers in told.items()} == {"b": 2000, "c": 2000}
    buffer._self_check()


INSERTS = {
    "messages": lambda buffer, links: buffer.set_transforms(links, "x"),
    "serialized": lambda buffer, links: buffer.set_transforms_cdr(encode(links), "x"),
}


@pytest.mark.parametrize("insert", INSERTS.values(), ids=INSERTS)
@pytest.mark.parametrize("tick", [0.05, 10.0])
def test_each_insert_of_a_call_is_judged_before_the_next_one(buffer, insert, tick):
    # With a tick of 50 ms, the call needs several slices.
    buffer.set_transform(transform("map", "odom", 1), "x")
    told = []
    waits = [buffer._wait("map", "odom", at_ns(11 * S + i), notify=told.append) for i in range(50)]
    waits.append(buffer._wait("map", "odom", at(11)))
    count = int(30 / tick)
    insert(buffer, [transform("map", "odom", 12 + tick * i) for i in range(count)])
    assert not buffer.can_transform_core("map", "odom", at(11))[0]
    assert [stamp_ns(message) for message in told] == [11 * S + i for i in range(50)]
    assert waits[-1].take() is not None
    buffer._self_check()


def insert(buffer, *seconds):
    for one in seconds:
        buffer.set_transform(transform("a", "b", one), "test")


CHANGES = {
    "insert": lambda buffer: insert(buffer, 40, 41),
    "clear": lambda buffer: buffer.clear(),
    "forget": lambda buffer: buffer.forget("b"),
    "restore": lambda buffer: buffer.__setstate__(type(buffer)().__getstate__()),
}


@pytest.mark.parametrize("what", CHANGES)
@pytest.mark.repeated
def test_other_threads_do_not_remove_what_an_insert_has_answered(tf2_py, what):
    # More waits than one slice tries, so the lock is released between two of them.
    for _ in range(times(8, 100)):
        buffer, told, count = tf2_py.BufferCore(Duration(seconds=10)), [], 500
        insert(buffer, 1)
        waits = [buffer._wait("a", "b", at(11), notify=told.append) for _ in range(count)]
        together(partial(insert, buffer, 12), partial(CHANGES[what], buffer))
        # All, unless the change came before the insert and removed what that needs.
        assert len(told) in ((count,) if what == "insert" else (0, count))
        assert buffer.statistics()["waiters"] == count - len(told)
        buffer._self_check()
        del waits


def together(*calls):
    """Call these in threads that begin at the same time."""
    begin = threading.Barrier(len(calls))

    def run(call):
        begin.wait()
        call()

    threads = [threading.Thread(target=run, args=(call,)) for call in calls]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


@pytest.mark.parametrize(
    ("script", "ends"),
    [
        # Inserts, each with its frame, or the wait, "?"; and whether the last insert ends it with the error.
        ("? b12 b21", False),
        ("? b12 b21.1", True),
        ("? b22", True),
        ("b22 ?", True),
        ("? b12 b12.5 b30", True),
        ("? c22", False),  # not connected
        ("? c22 b12", True),
        ("? b12 c12 c22", True),
        ("? b12 c5 b22", False),  # it lacks data of `c` the most
        ("? b12 c5 b22 c13", True),
        ("? b12 c13 b13 d40", False),  # not on the path
    ],
)
@pytest.mark.parametrize("is_downwards", [False, True])
def test_a_wait_until_its_data_is_refused_ends_then(buffer, script, ends, is_downwards):
    got, frames = [], ("a", "c" if "c" in script else "b")
    if is_downwards:
        frames = frames[::-1]
    for word in script.split():
        assert got == []
        if word == "?":
            wait = buffer._wait(*frames, at(11), notify=lambda *given: got.append(given), until_refused=True)
        else:
            parent = {"b": "a", "c": "b", "d": "c"}[word[0]]
            buffer.set_transform(transform(parent, word[0], float(word[1:])), "test")
        buffer._self_check()
    assert len(got) == (ends and script[-1] != "?")
    if ends:
        with pytest.raises(ExtrapolationException, match="Requested time 11|time 11.* but only time"):
            wait.take()
    assert buffer.statistics()["waiters"] == (not ends)


@pytest.mark.parametrize("target_is_latest", [False, True])
def test_a_wait_with_one_latest_time_may_lack_data_of_any_frame(buffer, target_is_latest):
    """Two frames without a common time get one from either of them."""
    buffer.set_transform_static(transform("map", "goal"), "x")
    buffer.set_transform(transform("map", "odom", 1), "x")
    buffer.set_transform(transform("odom", "base", 5), "x")
    (target, target_time), (source, time) = ("goal", at(3)), ("base", at(0))
    if target_is_latest:
        (target, target_time), (source, time) = (source, time), (target, target_time)
    told = []
    wait = buffer._wait(target, source, time, "map", target_time, notify=told.append)
    assert wait.take() is None and told == []
    buffer.set_transform(transform("map", "odom", 6), "x")
    buffer._self_check()
    assert told == [wait.take()] and told[0].child_frame_id == source


def test_waits_are_made_by_buffers_alone(buffer):
    cls = type(buffer._wait("map", "map", at(1)))
    with pytest.raises(TypeError):
        cls()
    del buffer
    cls.__new__(cls)  # and dropping it does no harm


def test_a_blocking_wait_that_ended_waits_no_more(buffer):
    def interrupted():
        raise KeyboardInterrupt

    waits = [buffer._wait("map", "odom", at(1)) for _ in range(2)]
    assert not waits[0].wait_for(1, never)
    with pytest.raises(KeyboardInterrupt):
        waits[1].wait_for(60 * S, interrupted)
    assert buffer.statistics()["waiters"] == 0


def test_what_does_not_touch_the_path_of_a_wait_for_changes_is_not_looked_at(buffer):
    buffer.set_transform(transform("map", "base", 1), "x")
    answers = []
    present = buffer._wait("map", "base", at(0))
    wait = buffer._wait("map", "base", at(0), notify=answers.append, after=present)
    for tick in range(100):
        buffer.set_transform(transform("base", "arm", 2 + tick), "x")
    assert answers == []
    assert buffer.statistics()["waiters"] == 1
    wait.cancel()  # it hands on what it was to differ from
    assert buffer._wait("map", "base", at(0), notify=print, after=wait).take() is None
