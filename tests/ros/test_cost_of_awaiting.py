# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Whatever runs a coroutine that awaits a transform: the wait costs next to nothing, and ends at once."""

import asyncio
import threading
import time

import coroutine_drivers
import pytest
from geometry_msgs.msg import PointStamped
from rclpy.time import Time
from times_and_transforms import S, transform
from waiting import until

QUIET_S = 1.0
MOST = 0.05  # of a core, while something awaits; a busy loop takes 0.6 to 1
LATEST = Time()


async def lookup(buffer, _):
    await buffer.lookup_transform_async("map", "robot", LATEST)


async def future(buffer, _):
    await buffer.wait_for_transform_async("map", "robot", LATEST)


async def transformed(buffer, _):
    point = PointStamped()
    point.header.frame_id = "robot"
    await buffer.transform_async(point, "map")


async def change(buffer, _):
    async for _ in buffer.changes("map", "robot"):
        return


async def filtered(buffer, waiting):
    async for _ in waiting:
        return


@pytest.fixture
def waiting(tf2_ros, buffer, node):
    """A filter with a message that waits."""
    point = PointStamped()
    point.header.frame_id = "robot"
    with tf2_ros.MessageFilter(None, buffer, "map", 10, node=node) as waiting:
        waiting.add(point)
        yield waiting


def share_of_a_core(seconds):
    """How much CPU time all threads of this process take in the next seconds."""
    begin, used = time.monotonic(), time.process_time()
    threading.Event().wait(seconds)
    return (time.process_time() - used) / (time.monotonic() - begin)


# Each driver, and each kind of wait in one driver of each kind.
CASES = [(driver, lookup) for driver in coroutine_drivers.ALL]
CASES += [
    (driver, what)
    for driver in (
        coroutine_drivers.single_threaded,
        coroutine_drivers.multi_threaded,
        coroutine_drivers.loop,
    )
    for what in (future, transformed, change, filtered)
]


@pytest.mark.parametrize(
    ("driver", "what"), [pytest.param(*case, id="-".join(one.__name__ for one in case)) for case in CASES]
)
def test_a_wait_costs_nothing_and_ends_with_the_message(driver, what, buffer, listener, node, waiting, peer):
    publisher, begun, ended = peer(), threading.Event(), threading.Event()

    async def work():
        begun.set()
        await what(buffer, waiting)
        ended.set()

    with driver(node) as run:
        task = run(work)
        until(begun.is_set)
        publisher.matched(1)  # the work of discovery is no cost of the wait
        until(lambda: share_of_a_core(QUIET_S) < MOST)
        assert not ended.is_set()
        publisher.send(("map", "robot", 1 * S, 1))
        until(ended.is_set)
        until(task.done)


def test_thousands_of_waits_in_a_loop_cost_nothing_either(buffer, node):
    count = 5000

    async def work():
        waits = [buffer.lookup_transform_async("map", "robot", LATEST) for _ in range(count)]
        await asyncio.gather(*waits)

    with coroutine_drivers.loop(node) as run:
        task = run(work)
        until(lambda: buffer.statistics()["waiters"] == count)
        until(lambda: share_of_a_core(QUIET_S) < MOST)
        buffer.set_transform(transform("map", "robot", 1.0, (0, 0, 0)), "me")
        until(task.done)


@pytest.mark.parametrize(
    "driver", [coroutine_drivers.single_threaded, coroutine_drivers.multi_threaded, coroutine_drivers.loop]
)
def test_of_many_waits_none_is_left(driver, buffer, node):
    count, ended = 300, []

    def work_for(number):
        async def work():
            await buffer.lookup_transform_async("map", f"robot{number}", LATEST)
            ended.append(number)

        return work

    with driver(node) as run:
        tasks = [run(work_for(number)) for number in range(count)]
        for number in range(count):
            buffer.set_transform(transform("map", f"robot{number}", 1.0, (0, 0, 0)), "me")
        until(lambda: len(ended) == count)
        until(lambda: all(task.done() for task in tasks))
    assert sorted(ended) == list(range(count))
