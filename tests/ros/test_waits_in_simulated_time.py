# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated time that starts late, is switched, stops and jumps, while something waits in every way."""

import asyncio
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest
from helper_threads import let_helper_threads_finish
from rclpy.clock import ClockType
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.time import Time
from spinning_nodes import spinning
from times_and_transforms import at, transform
from waiting import DEADLINE_S, PROMPT_S, until

WANTED_S = 2000  # the stamp that everything waits for
TIMEOUT_S = 1.0
# What happens before the waits begin, and while they last: simulated time is switched on or off, or set.
EVENTS = {
    "simulated time begins late": ([True], [WANTED_S]),
    "it is far ahead": ([True, 10], [2**31 - 1]),
    "it jumps back": ([True, 3000], [1500]),
    "it begins anew": ([True, 3000], [0]),
    "it stands still": ([True, 100], []),
    "it is switched on": ([], [True]),
    "it is switched off": ([True, 1500], [False]),
    "it is switched off and on": ([True, 1500], [False, True, 1000]),
}


def change_time(node, steps):
    for step in steps:
        if isinstance(step, bool):
            node.set_parameters([Parameter("use_sim_time", value=step)])
        else:
            node.get_clock().set_ros_time_override(Time(seconds=step, clock_type=ClockType.ROS_TIME))


@pytest.fixture
def waiting(tf2_ros, node, executor):
    """Begins a wait of each kind during an event, and gives the buffer and the outcomes by kind."""

    def outcome(call):
        began = time.monotonic()
        try:
            ended = "answered" if call() else "no"
        except tf2_ros.TransformException as error:
            ended = type(error).__name__
        return ended, time.monotonic() - began

    def put_or_call(future):
        until(future.done)
        return future.result()

    @contextmanager
    def begin(event, timeout_s):
        before, meanwhile = EVENTS[event]
        change_time(node, before)
        buffer, timeout = tf2_ros.Buffer(Duration(seconds=5000), node), Duration(seconds=timeout_s)
        buffer.set_transform(transform("map", "robot", 1), "me")
        buffer.set_transform_static(transform("robot", "camera"), "me")
        asked = "map", "robot", at(WANTED_S)
        calls = {
            "lookup": lambda: buffer.lookup_transform(*asked, timeout),
            "can": lambda: buffer.can_transform(*asked, timeout),
            "await": lambda: asyncio.run(buffer.lookup_transform_async(*asked, timeout=timeout)),
            "future": lambda: put_or_call(buffer.wait_for_transform_async(*asked, timeout=timeout)),
        }
        with spinning(executor), ThreadPoolExecutor() as pool:
            pending = {kind: pool.submit(outcome, call) for kind, call in calls.items()}
            # On a busy machine some may have expired before others begin.
            until(lambda: buffer.statistics()["waiters"] == len(calls) or pending["can"].done())
            change_time(node, meanwhile)
            yield buffer, pending
        let_helper_threads_finish()
        assert buffer.statistics()["waiters"] == 0

    return begin


@pytest.mark.parametrize("event", EVENTS)
def test_waits_go_on_and_are_answered(waiting, event):
    with waiting(event, DEADLINE_S) as (buffer, pending):
        # What was cleared does not answer, nor does it keep what comes from doing so.
        assert buffer.can_transform("robot", "camera", 0)
        buffer.set_transform(transform("map", "robot", WANTED_S - 1), "me")
        assert buffer.statistics()["waiters"] == len(pending)
        buffer.set_transform(transform("map", "robot", WANTED_S), "me")
        assert {one.result(DEADLINE_S)[0] for one in pending.values()} == {"answered"}


@pytest.mark.parametrize("event", ["it is far ahead", "it stands still", "it is switched off"])
def test_timeouts_count_steady_time(waiting, event):
    with waiting(event, TIMEOUT_S) as (_, pending):
        ended = {kind: one.result(DEADLINE_S) for kind, one in pending.items()}
    assert ended["lookup"][0] in ("ExtrapolationException", "LookupException", "ConnectivityException")
    assert [ended[kind][0] for kind in ("can", "await", "future")] == ["no", *["TimeoutException"] * 2]
    assert all(TIMEOUT_S <= took < PROMPT_S for _, took in ended.values())
