# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Waits in every way while the time of day is set.

Run with `interposed/time_of_day.c` loaded: `waits_while_system_time_is_set.py SECONDS TIMEOUT`. For each way
it prints a line of JSON: how long it lasted, its outcome, and how much processor time it took. The processor
time of a wait counts from the step on.
"""

import asyncio
import ctypes
import json
import os
import sys
import threading
import time

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from times_and_transforms import S, transform
from waiting import until

from tf2_ros import Buffer, MessageFilter, TransformBroadcaster, TransformException, TransformListener


class Step:
    """Sets the clock once something waits in the buffer, in a thread; then inserts, if asked to."""

    def __init__(self, buffer, clock, ns, insert=False):
        self._buffer, self._clock, self._ns, self._insert = buffer, clock, ns, insert
        self._is_over = False
        self.happened = False
        self.cpu = 0.0
        self._thread = threading.Thread(target=self._run)

    def _run(self):
        while not self._buffer.statistics()["waiters"]:
            if self._is_over:
                return
            os.sched_yield()
        self.cpu = time.process_time()
        self._clock.value += self._ns
        self.happened = True
        if self._insert:
            self._buffer.set_transform(transform("map", "base", 1), "test")

    def __enter__(self):
        self._before = self._clock.value
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._is_over = True
        self._thread.join()
        self._clock.value = self._before


def blocking(buffer, timeout_s):
    return buffer.lookup_transform("map", "base", 1 * S, timeout_s).header.frame_id


def can(buffer, timeout_s):
    return buffer.can_transform("map", "base", 1 * S, timeout_s)


def awaiting(buffer, timeout_s):
    awaited = buffer.lookup_transform_async("map", "base", 1 * S, timeout=timeout_s)
    return asyncio.run(awaited).header.frame_id


def in_an_executor(buffer, timeout_s):
    future = buffer.wait_for_transform_async("map", "base", 1 * S, timeout=timeout_s)
    rclpy.get_global_executor().spin_until_future_complete(future)
    return future.result().header.frame_id


def filtering(buffer, timeout_s):
    executor = rclpy.get_global_executor()
    [node] = executor.get_nodes()
    message, found = PointStamped(), Future()
    message.header.frame_id, message.header.stamp.sec = "base", 1
    timeout = Duration(seconds=timeout_s)
    with MessageFilter(None, buffer, "map", 1, node=node, buffer_timeout=timeout) as waiting:
        waiting.registerCallback(lambda _: found.set_result("map"))
        waiting.registerFailureCallback(lambda _, reason: found.set_result(reason.name))
        waiting.add(message)
        while not found.done():  # Humble's executors do not notice at once what another thread sets
            executor.spin_once(timeout_sec=timeout_s)
    return found.result()


WAYS = [blocking, can, awaiting, in_an_executor, filtering]


def tell(what, begin, cpu, outcome):
    lasted = {"s": time.monotonic() - begin, "cpu_s": time.process_time() - cpu}
    print(json.dumps({"what": what, **lasted, "outcome": outcome}), flush=True)


def wait(way, clock, ns, timeout_s, insert):
    buffer = Buffer()
    begin = time.monotonic()
    with Step(buffer, clock, ns, insert) as step:
        try:
            outcome = way(buffer, timeout_s)
        except TransformException as error:
            outcome = type(error).__name__
        tell(f"{way.__name__}{', then inserts' * insert}", begin, step.cpu, outcome)
    assert step.happened, "it was over before the clock could be set"
    assert buffer.statistics()["waiters"] == 0


def receive(clock, ns, timeout_s):
    """A listener before, and after its clock was set; and rounds of an executor that find nothing."""
    node = rclpy.create_node("receiving")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    buffer = Buffer(node=node)
    listener = TransformListener(buffer, node)
    sender = TransformBroadcaster(node)
    for seconds in (1, 2):
        begin, cpu = time.monotonic(), time.process_time()

        def is_received(seconds=seconds):
            sender.sendTransform(transform("map", "base", seconds))
            return buffer.can_transform("map", "base", seconds * S)

        until(is_received, executor)
        tell(f"receives {seconds}", begin, cpu, True)
        clock.value += ns
    begin, cpu = time.monotonic(), time.process_time()
    future = buffer.wait_for_transform_async("map", "nobody", 1 * S, timeout=timeout_s)
    while not future.done():
        executor.spin_once(timeout_sec=timeout_s)
    tell("spin_once", begin, cpu, type(future.exception()).__name__)
    clock.value = 0
    listener.unregister()
    executor.shutdown()
    node.destroy_node()


def main():
    seconds, timeout_s = map(float, sys.argv[1:])
    clock = ctypes.c_long.in_dll(ctypes.CDLL(None), "wall_offset_ns")
    ns = round(seconds * S)
    rclpy.init()
    # Until the end: where one is destroyed after the time of day was set back, rclpy may crash.
    node = rclpy.create_node("waiting")
    rclpy.get_global_executor().add_node(node)
    for insert in (False, True):
        for way in WAYS:
            wait(way, clock, ns, timeout_s, insert)
    receive(clock, ns, timeout_s)
    rclpy.shutdown()
    del node


if __name__ == "__main__":
    main()
