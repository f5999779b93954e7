# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure nodes that listen to /tf: their CPU, and how soon waits return."""

import contextlib
import queue
import threading
import time
from time import perf_counter_ns

import rclpy
from geometry_msgs.msg import TransformStamped
from load_publisher import Publisher, stamp_ns
from measured_library import AUTHORITY
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.time import Time
from tf2_ros_library import S, fill

from tf2_ros import Buffer, TransformListener

LOADS = ((50, 200), (1, 500))  # transforms in a message, messages a second
TIMEOUT = Duration(seconds=60)
WAKE_RATE = 100
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)


class ThroughPython(TransformListener):
    """A listener with a callback of its own receives messages."""

    def callback(self, data):
        for transform in data.transforms:
            self.buffer.set_transform(transform, AUTHORITY)


class Listening:
    """
    A node with a listener, and a thread that spins it.

    :param kind: `listener`; `overridden`: ThroughPython. `spin_once`, `executor.spin_once`: as `listener`,
        but the thread calls this in a loop, without and with a timeout; `spin_once+lookup`: it also looks a
        frame up in each turn.
    """

    def __init__(self, kind="listener"):
        rclpy.init()
        self.node, self.buffer = rclpy.create_node("bench_listening"), Buffer()
        make = ThroughPython if kind == "overridden" else TransformListener
        self._listener = make(self.buffer, self.node)
        self._thread = threading.Thread(target=self._run, args=(kind,))
        self._thread.start()

    def _run(self, kind):
        with contextlib.suppress(ExternalShutdownException):
            if "spin_once" in kind:
                self._spin_in_loop(kind)
            else:
                rclpy.spin(self.node)

    def _spin_in_loop(self, kind):
        executor = SingleThreadedExecutor() if kind == "executor.spin_once" else None
        if executor is not None:
            executor.add_node(self.node)
        while rclpy.ok():
            if executor is not None:
                executor.spin_once(timeout_sec=0.1)
            else:
                rclpy.spin_once(self.node)
            if kind == "spin_once+lookup":
                self.buffer.can_transform("map", "f0", Time())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        rclpy.shutdown()
        self._thread.join()

    def receive(self, publisher, rate, transforms, messages):
        """Have messages published, and wait until the buffer has the last one."""
        first = publisher.start(rate, transforms, messages)
        publisher.finish()
        last = Time(nanoseconds=stamp_ns(first + messages - 1))
        if not self.buffer.can_transform("map", "f0", last, TIMEOUT):
            raise RuntimeError(f"the last of {messages} messages did not arrive")


def cpu(rows, sizes, _, kind):
    """CPU of a process per message that it receives while nobody else looks."""
    with Listening(kind) as listening, Publisher(1) as publisher:
        # The largest messages first: every frame has a full history then.
        listening.receive(publisher, *reversed(LOADS[0]), sizes.filling)
        for transforms, rate in LOADS:
            messages = round(rate * sizes.receive_s)
            before_ns = time.process_time_ns()
            listening.receive(publisher, rate, transforms, messages)
            each_ns = (time.process_time_ns() - before_ns) / messages
            rows.add(kind, {"transforms": transforms, "Hz": rate}, [each_ns])


def waits(rows, sizes, _, variant):
    """How soon a waiting lookup returns: from an insert in its process, from sending in another."""
    with Listening() as listening, Publisher(1) as publisher:
        listening.receive(publisher, WAKE_RATE, 1, 1)
        if variant == "own insert":
            times = _wake(listening.buffer, sizes.wakes)
        else:
            first = publisher.start(WAKE_RATE, 1, sizes.wakes)
            times = look(listening.buffer, range(first, first + sizes.wakes))
            publisher.finish()
        rows.add(variant, {"Hz": WAKE_RATE}, times)


def look(buffer, numbers):
    """ns from the sending of each message until a lookup of its transform, which began before, returns."""
    answers = []
    for number in numbers:
        stamp = Time(nanoseconds=stamp_ns(number))
        if buffer.can_transform_core("map", "f0", stamp)[0]:
            continue
        answer = buffer.lookup_transform("map", "f0", stamp, TIMEOUT)
        answers.append(1e9 * (time.monotonic() - answer.transform.translation.x))
    return answers


def _wake(buffer, count):
    """ns from the call of an insert until the lookup in another thread that waits for it has returned."""
    stamps_ns = [stamp_ns(i) for i in range(count)]
    returned = queue.SimpleQueue()

    def wait():
        for ns in stamps_ns:
            buffer.lookup_transform("map", "own", Time(nanoseconds=ns), TIMEOUT)
            returned.put(perf_counter_ns())

    waiting = threading.Thread(target=wait)
    waiting.start()
    answers = []
    for ns in stamps_ns:
        transform = fill(TransformStamped(), "own", "map", ns, POSE)
        time.sleep(1 / WAKE_RATE)
        start = perf_counter_ns()
        buffer.set_transform(transform, AUTHORITY)
        answers.append(returned.get(timeout=TIMEOUT.nanoseconds / S) - start)
    waiting.join()
    return answers
