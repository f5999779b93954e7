# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Forks children while its other threads are busy with a buffer; prints how each ended.

Arguments: what each child does (a method of `Parent`), and how many children there are. Another process must
publish meanwhile. A child that hangs is killed, counts as -9 and is the last.
"""

import asyncio
import faulthandler
import gc
import itertools
import json
import multiprocessing
import os
import sys
import threading
import time

import numpy as np
import rclpy
from forked_children import CHILD_S, fork, status_of
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor
from rclpy.time import Time
from times_and_transforms import at, transform

import tf2_ros

SHORT = Duration(seconds=0.02)
LONG = Duration(seconds=60)
AT_ONCE = 4  # children
TIMES_NS = np.linspace(10**9, 2 * 10**9, 100_000).astype(np.int64)


class Listener(tf2_ros.TransformListener):
    """One that an executor serves."""

    def callback(self, data):
        super().callback(data)


class Parent:
    def __init__(self):
        rclpy.init()
        self.node = rclpy.create_node("forking")
        self.buffer = tf2_ros.Buffer(node=self.node)
        self.listeners = [
            tf2_ros.TransformListener(self.buffer, self.node),
            Listener(self.buffer, self.node),
            tf2_ros.TransformListener(self.buffer, None),
        ]
        self.client = tf2_ros.BufferClient(self.node, "nobody")
        self.filter = tf2_ros.MessageFilter(None, self.buffer, "map", 10, node=self.node)
        self.broadcaster = tf2_ros.StaticTransformBroadcaster(self.node)
        self.executor = MultiThreadedExecutor(2)
        self.executor.add_node(self.node)
        for seconds in (1, 2):
            self.buffer.set_transform(transform("map", "robot", seconds), "parent")
        self.numbers = itertools.count()
        self.waits = [self.buffer._wait("nest", "cup", at(1 + i / 10_000), notify=print) for i in range(5000)]
        # In a child nothing completes it: the child ends it itself.
        self.future = self.buffer.wait_for_transform_async("map", "child", Time(), timeout=LONG)

    def make_busy(self):
        """Start threads that never rest."""
        for work in (
            self.executor.spin_once,
            lambda: self.buffer.lookup_transforms("map", "robot", TIMES_NS),
            lambda: self.buffer.set_transform(transform("map", "other", 1), "parent"),
            lambda: self.buffer.set_transforms([transform("map", f"o{i}", 1) for i in range(300)], "parent"),
            self.move_the_cup,
            self.buffer.all_frames_as_yaml,
            lambda: self.buffer.can_transform("map", "nowhere", Time(), SHORT),
            self.wait_in_vain,
            self.wait_with_success,
        ):
            threading.Thread(target=keep_doing, args=(work,), daemon=True).start()

    def move_the_cup(self):
        """It gets another parent, so all that wait for it are tried, in many slices."""
        n = next(self.numbers)
        self.buffer.set_transform(transform(f"hand {n % 2}", "cup", ns=2 * 10**9 + n * 10_000_000), "parent")

    def wait_in_vain(self):
        future = self.buffer.wait_for_transform_async("map", "nowhere", Time(), timeout=SHORT)
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        done.wait()
        future.exception()

    def wait_with_success(self):
        future = self.buffer.wait_for_transform_async("map", "other", at(1))
        future.add_done_callback(lambda _: None)
        asyncio.run(self.buffer.lookup_transform_async("map", "robot", at(1.5)))

    def use(self):
        """All that a child may do."""
        buffer = self.buffer
        buffer._self_check()
        assert buffer.can_transform("map", "robot", at(1.5))
        assert len(buffer.lookup_transforms("map", "robot", TIMES_NS[:1000])[0]) == 1000
        assert not buffer.can_transform("map", "nowhere", Time(), SHORT)
        future = buffer.wait_for_transform_async("map", "nowhere", Time(), timeout=SHORT)
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        assert done.wait(CHILD_S / 4)
        assert type(future.exception()) is tf2_ros.TimeoutException
        waiting = buffer.wait_for_transform_async("map", "child", Time())
        buffer.set_transform_static(transform("map", "child"), "child")
        assert waiting.done()
        assert self.future.is_dead()
        assert not any(listener.receives for listener in self.listeners)
        try:
            self.client.lookup_transform("map", "robot", Time(), SHORT)
        except RuntimeError as error:
            assert "dead in this forked process" in str(error)
            return
        raise AssertionError("a client in a child answered")

    def drop(self):
        """End everything, by hand and by dropping it."""
        self.use()
        self.filter.close()
        self.client.destroy()
        for listener in self.listeners:
            listener.unregister()
        for name in list(vars(self)):
            if name != "node":
                delattr(self, name)
        gc.collect()

    def have_a_node(self):
        """
        Receive with a node of its own, as the target of a multiprocessing.Process.

        One child at a time: Fast DDS gives the first participants of several children the same GUID.
        """
        context = rclpy.Context()
        rclpy.init(context=context)
        node = rclpy.create_node("child", context=context)
        buffer = tf2_ros.Buffer(node=node)
        listener = tf2_ros.TransformListener(buffer, node, spin_thread=True)
        assert buffer.can_transform("map", "f0", Time(), Duration(seconds=20))
        waiting = buffer.wait_for_transform_async("map", "f0", buffer.get_latest_common_time("map", "f0"))
        assert waiting.done() and listener.receives == ("/tf", "/tf_static")
        # One for a buffer that it inherited, too.
        with tf2_ros.TransformListener(self.buffer, node):
            taken = self.buffer.statistics()["taken"]
            while self.buffer.statistics()["taken"] == taken:
                time.sleep(0.01)
        rclpy.shutdown(context=context)
        self.use()


def keep_doing(work):
    while True:
        work()


def multiprocess(work):
    """A child of multiprocessing; its process id."""
    child = multiprocessing.get_context("fork").Process(target=work)
    child.start()
    return child.pid


def status_of_own_node(work):
    """How a child with a node of its own ended, in a list; one that hangs prints the stack of each thread."""

    def child():
        faulthandler.dump_traceback_later(CHILD_S / 2, exit=True)
        work()

    return [status_of(multiprocess(child))]


def statuses_of(work, count):
    """How children ended."""
    children, statuses = [], []
    for _ in range(count):
        children.append(fork(work))
        if len(children) == AT_ONCE:
            statuses.append(status_of(children.pop(0)))
            if statuses[-1] != 0:
                break
    return [*statuses, *map(status_of, children)]


def main(what, count):
    parent = Parent()
    while parent.buffer.statistics()["taken"] < 100:
        time.sleep(0.01)
    parent.make_busy()
    work = getattr(parent, what)
    statuses = status_of_own_node(work) if what == "have_a_node" else statuses_of(work, count)
    taken = parent.buffer.statistics()["taken"]
    while parent.buffer.statistics()["taken"] < taken + 100:
        time.sleep(0.01)
    print(json.dumps(statuses), flush=True)
    os._exit(any(statuses))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
