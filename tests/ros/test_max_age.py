# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lookups of the latest transform under a `max_age`, and limits for single frames."""

import asyncio
import copy
import gc
import pickle
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter
from rclpy.time import Time
from simulated_clock import simulate
from times_and_transforms import S, insert, stamp_ns, transform
from waiting import DEADLINE_S, until

from tf2_py import BufferCore

LATEST = Time()
ROBOT = ("map", "base", LATEST)


@pytest.fixture
def buffer(tf2_ros, node):
    """A localiser at 2 Hz, odometry at 64 Hz, and a camera fixed to the robot; the clock is at 100 s."""
    simulate(node, seconds=100)
    buffer = tf2_ros.Buffer(node=node)
    insert(buffer, "map", "odom", 98, 98.5, 99)
    insert(buffer, "odom", "base", *(98 + i / 64 for i in range(125)))
    buffer.set_transform_static(transform("base", "camera", 3), "x")
    return buffer


def test_the_error_names_the_frame_that_is_furthest_beyond_its_limit(tf2_ros, buffer):
    def error(**limits):
        with pytest.raises(tf2_ros.ExtrapolationException) as raised:
            buffer.lookup_transform("map", "camera", LATEST, **limits)
        return str(raised.value)

    assert error(max_age=0.01) == (
        "The latest transform from frame [camera] to frame [map] is too old; the newest sample of odom in "
        "map, at 99.000000000, is 1.000000000 s old by the clock of the buffer, at 100.000000000; max_age "
        "allows 0.010000000 s"
    )
    assert "of base in odom, at 99.937500000, is 0.062500000 s" in error(max_age={"odom": 0.99, "base": 0.01})


def test_a_stamp_of_0_seems_not_to_be_set_to_a_clock_that_shows_the_date(tf2_ros):
    buffer = tf2_ros.Buffer()
    insert(buffer, "map", "base", 0)
    with pytest.raises(tf2_ros.ExtrapolationException, match=r"\. Its stamp is 0: was it never set\?$"):
        buffer.lookup_transform(*ROBOT, max_age=1)


WAYS = {
    "lookup_transform": lambda b, **p: b.lookup_transform(*ROBOT, **p),
    "with a timeout": lambda b, **p: b.lookup_transform(*ROBOT, 0.01, **p),
    "async": lambda b, **p: asyncio.run(b.lookup_transform_async(*ROBOT, timeout=0.01, **p)),
    "future": lambda b, **p: ended(b.wait_for_transform_async(*ROBOT, timeout=0.01, **p)),
    "many": lambda b, **p: b.lookup_transforms("map", ["base", "camera"], [LATEST], **p),
}


def ended(future):
    until(future.done)
    return future.result()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    ("limits", "error", "text"),
    [
        ({"max_age": -1}, ValueError, r"max_age must not be negative, got -1\.0"),
        ({"max_age": {"odom": -1}}, ValueError, r"max_age\['odom'\] must not be negative"),
        ({"tolerance": {"odom": -0.5}}, ValueError, r"tolerance\['odom'\] must not be negative, got -0\.5"),
        ({"max_age": float("nan")}, ValueError, "max_age: expected .* NaN"),
        ({"max_age": {"odom": float("nan")}}, ValueError, r"max_age\['odom'\]: expected .* NaN"),
        ({"max_age": "1"}, TypeError, "max_age: expected a duration"),
        ({"max_age": True}, TypeError, "max_age: expected a duration"),
        ({"max_age": [("odom", 1)]}, TypeError, "max_age: expected a duration"),
        ({"max_age": {"odom": None}}, TypeError, r"max_age\['odom'\]: expected a duration"),
        ({"max_age": {1: 1}}, TypeError, "a frame of max_age: expected a str, got int"),
        ({"max_age": {"od\0m": 1}}, ValueError, "NUL"),
        ({"max_age": {"": 1}}, ValueError, "max_age.* cannot be empty"),
        ({"max_age": {"/odom": 1}}, ValueError, r"max_age.* cannot start with a '/'.*\[odom\]"),
        ({"tolerance": {"Odom": 1}}, ValueError, r"^tolerance .* \[Odom\], which does not exist.*\[odom\]"),
        ({"maxage": 1}, TypeError, "'maxage'. Did you mean 'max_age'"),
    ],
    ids=str,
)
def test_wrong_limits_are_refused(buffer, way, limits, error, text):
    with pytest.raises(error, match=text):
        WAYS[way](buffer, **limits)


def test_only_the_latest_transform_has_an_age(tf2_ros, buffer):
    pytest.importorskip("tf2_geometry_msgs")
    at = Time(seconds=99)
    for call, argument in (
        (lambda: buffer.lookup_transform("map", "base", at, max_age=1), "time"),
        (lambda: buffer.can_transform("map", "base", 99 * S, 0.1, max_age=1), "time"),
        (lambda: buffer.lookup_transform_full("map", at, "base", 0, "odom", max_age=1), "target_time"),
        (lambda: buffer.lookup_transform_full("map", 0, "base", at, "odom", max_age=1), "source_time"),
        (lambda: buffer.transform(transform("base", "data", 99), "map", max_age=1), "time"),
        (lambda: buffer.lookup_transforms("map", "base", [0, 99 * S], max_age=1), "every time"),
        (lambda: buffer.lookup_matrices("map", "base", [99 * S], max_age=1), "every time"),
        (lambda: buffer.transform_points([(0, 0, 0)], [99 * S], "map", "base", max_age={}), "every time"),
        (lambda: buffer.lookup_matrix("map", "base", at, max_age=1), "time"),
        (
            lambda: buffer.lookup_matrix("map", "base", at, fixed_frame="odom", target_time=0, max_age=1),
            "time",
        ),
        (lambda: buffer.wait_for_transform_async("map", "base", at, max_age=1), "time"),
    ):
        with pytest.raises(ValueError, match=rf"so {argument} must be 0, got 99\.000000000 s"):
            call()


# Frames of limits that are not known.


@pytest.mark.parametrize("way", ["with a timeout", "async", "future"])
@pytest.mark.parametrize("argument", ["max_age", "tolerance"])
def test_a_misspelt_limit_ends_a_wait_when_the_path_is_there(tf2_ros, node, way, argument):
    simulate(node, seconds=100)
    buffer = tf2_ros.Buffer(node=node)
    waits = {
        "with a timeout": lambda: buffer.lookup_transform(*ROBOT, DEADLINE_S, **{argument: {"odm": 1}}),
        "async": lambda: asyncio.run(buffer.lookup_transform_async(*ROBOT, **{argument: {"odm": 1}})),
        "future": lambda: ended(buffer.wait_for_transform_async(*ROBOT, **{argument: {"odm": 1}})),
    }
    with ThreadPoolExecutor() as pool:
        pending = pool.submit(waits[way])
        until(lambda: buffer.statistics()["waiters"] == 1)
        insert(buffer, "map", "odom", 100)
        assert buffer.statistics()["waiters"] == 1
        insert(buffer, "odom", "base", 100)
        with pytest.raises(ValueError, match=r"\[odm\], .*Did you mean \[odom\]"):
            pending.result(DEADLINE_S)
    assert buffer.statistics()["waiters"] == 0


# Waits.


@pytest.fixture(params=["blocking", "can", "await", "future"])
def wait(request, buffer):
    """Begins a wait for the robot in a way; its result is the stamp of the answer, in nanoseconds."""
    calls = {
        "blocking": lambda **p: stamp_ns(buffer.lookup_transform(*ROBOT, DEADLINE_S, **p)),
        "can": lambda **p: (
            buffer.can_transform(*ROBOT, DEADLINE_S, **p) and stamp_ns(buffer.lookup_transform(*ROBOT))
        ),
        "await": lambda **p: stamp_ns(asyncio.run(buffer.lookup_transform_async(*ROBOT, **p))),
        "future": lambda **p: stamp_ns(ended(buffer.wait_for_transform_async(*ROBOT, **p))),
    }
    with ThreadPoolExecutor() as pool:

        def begin(**limits):
            before = buffer.statistics()["waiters"]
            pending = pool.submit(calls[request.param], **limits)
            until(lambda: buffer.statistics()["waiters"] == before + 1)
            return pending

        yield begin
    assert buffer.statistics()["waiters"] == 0


def test_a_wait_ends_with_the_last_frame_that_was_stale(wait, buffer, node):
    simulate(node, seconds=200)
    pending = wait(max_age=1)
    insert(buffer, "map", "odom", 199.5)
    insert(buffer, "odom", "base", 198, 198.5)
    assert not pending.done()
    insert(buffer, "odom", "base", 199)
    assert pending.result(DEADLINE_S) == 199 * S


@pytest.mark.parametrize("seconds", [99.9, 50])
def test_waits_follow_a_clock_that_jumps_back(wait, buffer, node, seconds):
    simulate(node, seconds=200)
    pending = wait(max_age=0.5)
    simulate(node, seconds=200 - 0.75)
    assert not pending.done()
    simulate(node, seconds=seconds)  # which clears the buffer
    insert(buffer, "map", "odom", seconds - 0.75, seconds - 0.25)
    insert(buffer, "odom", "base", seconds - 0.5)
    assert pending.result(DEADLINE_S) == round((seconds - 0.5) * S)


def test_simulated_time_that_begins_late(tf2_ros, node):
    node.set_parameters([Parameter("use_sim_time", value=True)])
    buffer = tf2_ros.Buffer(node=node)
    insert(buffer, "map", "base", 100)
    with pytest.raises(tf2_ros.ExtrapolationException, match="has no known age: .* has not begun"):
        buffer.lookup_transform("map", "base", LATEST, max_age=1)
    waiting = buffer.wait_for_transform_async("map", "base", LATEST, max_age=1)
    with ThreadPoolExecutor() as pool:
        blocked = pool.submit(buffer.lookup_transform, "map", "base", LATEST, 10 * DEADLINE_S, max_age=1)
        awaited = pool.submit(asyncio.run, buffer.lookup_transform_async("map", "base", LATEST, max_age=1))
        until(lambda: buffer.statistics()["waiters"] == 3)
        simulate(node, seconds=100)
        assert buffer.lookup_transform("map", "base", LATEST, max_age=1)
        until(waiting.done)  # without another insert
        assert waiting.result() == blocked.result(DEADLINE_S) == awaited.result(DEADLINE_S)


def test_simulated_time_that_is_switched_while_something_waits(tf2_ros, node):
    buffer = tf2_ros.Buffer(node=node)
    now_ns = time.time_ns()
    waiting = buffer.wait_for_transform_async("map", "base", LATEST, max_age=60)
    simulate(node, seconds=50)
    buffer.set_transform(transform("map", "base", 45), "x")
    assert waiting.done()
    waiting = buffer.wait_for_transform_async("map", "base", LATEST, max_age=1)
    node.set_parameters([Parameter("use_sim_time", value=False)])
    buffer.set_transform(transform("map", "base", 49.5), "x")
    assert not waiting.done()
    buffer.set_transform(transform("map", "base", ns=now_ns + 60 * S), "x")
    assert waiting.done()


def test_system_time_is_read_at_each_insert(tf2_ros):
    buffer = tf2_ros.Buffer()
    age_s = 0.25
    pending = buffer.wait_for_transform_async("map", "arm", LATEST, max_age=age_s)
    stamp = time.time_ns()
    buffer.set_transform(transform("map", "base", ns=stamp), "x")
    until(lambda: time.time_ns() - stamp > age_s * S)
    late = time.time_ns()
    buffer.set_transforms([transform("base", "arm", ns=ns) for ns in (stamp, late)], "x")
    assert not pending.done()
    buffer.set_transforms(
        [transform(*pair, ns=late + 60 * S) for pair in (("map", "base"), ("base", "arm"))], "x"
    )
    assert pending.done()


@pytest.mark.parametrize("ends", ["cancel", "drop"])
def test_a_wait_that_ends_while_the_clock_is_read_is_removed(tf2_ros, ends):
    waiting, seconds = [], [10]

    def now():
        if seconds[0] == 20 and waiting:
            one = waiting.pop()
            if ends == "cancel":
                one.cancel()
        return seconds[0] * S

    buffer = tf2_ros.Buffer()
    buffer.clock = SimpleNamespace(now=now)
    insert(buffer, "map", "base", 1)
    waiting.append(buffer.wait_for_transform_async("map", "base", LATEST, max_age=0.5))
    seconds[0] = 20
    insert(buffer, "map", "base", 10)  # answered by the clock that was read last, and then judged
    assert waiting == []
    gc.collect()
    assert buffer.statistics()["waiters"] == 0
    insert(buffer, "map", "base", 20)
    buffer._self_check()


def test_a_simulated_clock_that_a_program_assigns_is_followed_too(tf2_ros, node):
    """Also where it is set back: nothing reports that to this buffer."""
    buffer = tf2_ros.Buffer()
    buffer.add_source("this test")
    simulate(node, seconds=100)
    buffer.clock = node.get_clock()
    insert(buffer, "map", "base", 99)
    assert buffer.ages("map", "base") == {"base": 1}
    simulate(node, seconds=50)
    with pytest.raises(tf2_ros.TransformException):
        buffer.ages("map", "base")
    insert(buffer, "map", "base", 49)
    assert buffer.ages("map", "base") == {"base": 1}


def test_a_clock_of_a_program_may_let_go_of_what_is_being_answered(tf2_ros):
    class Forgets(Clock):
        def now(self):
            waiting.clear()
            overwriting.extend(b"\xff" * size for size in range(64, 2048))  # what was freed
            return Time(seconds=10)

    buffer, waiting, overwriting = tf2_ros.Buffer(), [], []
    buffer.clock = Forgets(clock_type=ClockType.SYSTEM_TIME)
    waiting.append(buffer.wait_for_transform_async("map", "base", LATEST, max_age=5))
    insert(buffer, "map", "base", 9)
    assert not waiting
    assert buffer.statistics()["waiters"] == 0


def test_an_answer_that_was_delivered_is_the_answer(buffer, node):
    pending = buffer.wait_for_transform_async(*ROBOT, max_age=0.5)
    insert(buffer, "map", "odom", 99.75)
    simulate(node, seconds=200)
    assert stamp_ns(pending.result()) == 99.75 * S


def test_what_an_await_returns_is_fresh_at_that_moment(buffer, node):
    async def follow():
        answer = asyncio.ensure_future(buffer.lookup_transform_async(*ROBOT, max_age=0.5))
        await asyncio.sleep(0)
        insert(buffer, "map", "odom", 99.75)  # which completes it; but before it runs again, time passes
        simulate(node, seconds=200)
        while not buffer.statistics()["waiters"]:
            await asyncio.sleep(0)
        assert not answer.done()
        insert(buffer, "map", "odom", 200)
        insert(buffer, "odom", "base", 200)
        return await answer

    assert stamp_ns(asyncio.run(follow())) == 200 * S


def test_a_timeout_counts_from_the_beginning_of_an_await(tf2_ros, buffer, node):
    async def follow():
        answer = asyncio.ensure_future(buffer.lookup_transform_async(*ROBOT, max_age=0.5, timeout=1))
        await asyncio.sleep(0)
        insert(buffer, "map", "odom", 99.75)
        simulate(node, seconds=200)
        await answer

    began = time.monotonic()
    with pytest.raises(tf2_ros.TimeoutException, match=r"Waited 1 s .* odom in map, at 99\.75"):
        asyncio.run(follow())
    assert time.monotonic() - began >= 1


def test_answers_that_become_stale_before_it_continues_do_not_prolong_an_await(tf2_ros, buffer, node):
    async def follow():
        answer = asyncio.ensure_future(buffer.lookup_transform_async(*ROBOT, max_age=0.5, timeout=0.3))
        await asyncio.sleep(0)
        seconds = 200
        while not answer.done() and time.monotonic() < began + DEADLINE_S:
            simulate(node, seconds=seconds)
            insert(buffer, "map", "odom", seconds)
            insert(buffer, "odom", "base", seconds)  # which completes it
            simulate(node, seconds=seconds + 10)
            while not (buffer.statistics()["waiters"] or answer.done()):
                await asyncio.sleep(0)
            await asyncio.sleep(0.01)  # the rate of the transforms
            seconds += 20
        assert answer.done()
        await answer

    began = time.monotonic()
    with pytest.raises(tf2_ros.TimeoutException, match=r"^Waited 0\.3 s"):
        asyncio.run(follow())


def test_at_the_timeout_the_error_describes_what_is_stale_then(tf2_ros, buffer, node):
    pending = buffer.wait_for_transform_async(*ROBOT, max_age={"odom": 0.5, "base": 0.5}, timeout=1)
    insert(buffer, "odom", "base", 100)
    simulate(node, seconds=105)
    insert(buffer, "map", "odom", 105)
    with pytest.raises(tf2_ros.TimeoutException, match=r"sample of base in odom, at 100.0*, is 5\.0"):
        ended(pending)
    with pytest.raises(tf2_ros.ExtrapolationException, match=r"max_age allows 0\.5.*\. Waited 0\.1 s$"):
        buffer.lookup_transform(*ROBOT, 0.1, max_age=0.5)


def test_many_threads_wait_while_others_insert(buffer, node):
    stop = threading.Event()

    def drive():
        for i in range(400):
            simulate(node, seconds=100 + i / 8)
            insert(buffer, "odom", "base", 100 + i / 8)
            if i % 8 == 7:
                insert(buffer, "map", "odom", 100 + i / 8)
        stop.set()

    def look():
        found = []
        while not stop.is_set():
            try:
                found.append(stamp_ns(buffer.lookup_transform(*ROBOT, 0.05, max_age=0.5)))
            except buffer_error:
                continue
        return found

    from tf2_py import TransformException as buffer_error

    with ThreadPoolExecutor() as pool:
        looking = [pool.submit(look) for _ in range(4)]
        pool.submit(drive).result(DEADLINE_S)
        found = [one.result(DEADLINE_S) for one in looking]
    assert all(one == sorted(one) for one in found)
    assert buffer.statistics()["waiters"] == 0
    buffer._self_check()


# Buffers without a clock.


def test_what_has_no_clock_says_so(tf2_ros):
    buffer = BufferCore()
    insert(buffer, "map", "base", 1)
    for call in (
        lambda: buffer.lookup_transforms("map", "base", [0], max_age=1),
        lambda: buffer.lookup_matrix("map", "base", 0, max_age=1),
        lambda: buffer.transform_points([(0, 0, 0)], [0], "map", "base", max_age={"base": 1}),
    ):
        with pytest.raises(ValueError, match="ages need a clock, which this buffer does not have"):
            call()
    without = tf2_ros.Buffer()
    without.clock = None  # as that of a recording
    for call in (
        lambda: without.lookup_transform("map", "base", LATEST, max_age=1),
        lambda: without.wait_for_transform_async("map", "base", LATEST, max_age=1),
        lambda: asyncio.run(without.lookup_transform_async("map", "base", LATEST, max_age=1)),
    ):
        with pytest.raises(ValueError, match="ages need a clock, which this buffer does not have"):
            call()
    insert(without, "map", "base", 1)
    for other in (copy.copy(without), copy.deepcopy(without), pickle.loads(pickle.dumps(without))):
        with pytest.raises(ValueError, match="ages need a clock, which this buffer does not have"):
            other.ages("map", "base")
    assert without.statistics()["waiters"] == 0
    assert buffer.lookup_transforms("map", "base", [2 * S], tolerance={"base": 1})
