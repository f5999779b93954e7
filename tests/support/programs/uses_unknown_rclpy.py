# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Uses all of tf2_ros with an rclpy that differs from those that are known, and prints what worked.

Arguments: ``functions`` of rcl are missing, or nothing; what rclpy does not promise is ``renamed``, of
``another type`` or ``raising``, or nothing.
"""

import asyncio
import ctypes
import sys
import threading
from functools import partial
from inspect import getattr_static
from pathlib import Path

if "functions" in sys.argv:

    class Lacking(ctypes.PyDLL):
        def __getitem__(self, name):
            return super().__getitem__(name.replace("rcl_take", "rcl_took"))

    ctypes.PyDLL = Lacking

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor
from rclpy.time import Time
from spinning_nodes import shut_down
from times_and_transforms import transform
from waiting import DEADLINE_S, until

import tf2_ros
from tf2_py._internal import assumptions
from tf2_ros import _rclpy

LACKS_FUNCTIONS = "functions" in sys.argv
WAY = {"renamed", "another type", "raising"}.intersection(sys.argv)


class Differing:
    """An attribute that only rclpy itself finds as it was."""

    def __init__(self, kind, name):
        self.name, self.original = name, getattr_static(kind, name, None)

    def __get__(self, one, kind=None):
        if Path(sys._getframe(1).f_code.co_filename).is_relative_to(Path(rclpy.__file__).parent):
            if self.original is not None:
                return self.original.__get__(one, kind)
            if self.name in vars(one):
                return vars(one)[self.name]
        elif "raising" in WAY:
            raise RuntimeError(self.name)
        elif "another type" in WAY:
            return object()
        raise AttributeError(self.name)

    def __set__(self, one, value):
        vars(one)[self.name] = value


if WAY:
    rows = [row for row in assumptions.ROWS if isinstance(row, assumptions.Attribute)]
    for row in rows:
        # Without the executor of a task, nothing asks for the locks of tasks.
        if LACKS_FUNCTIONS or row.names != ["_executor"]:
            for name in row.names:
                setattr(row.kind, name, Differing(row.kind, name))
    for kind, name in [(Time, "_time_handle"), (Duration, "_duration_handle")]:
        setattr(kind, name, Differing(kind, name))
    _rclpy.GuardCondition = partial(int, unknown_argument=0)
    if LACKS_FUNCTIONS:
        _rclpy.EventHandler = partial(int, unknown_argument=0)


def main():
    rclpy.init()
    node, sender = rclpy.create_node("using"), rclpy.create_node("sending")
    executor = MultiThreadedExecutor(2)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    buffer = tf2_ros.Buffer(node=node)
    listener = tf2_ros.TransformListener(buffer, node)
    print("without an executor:", ", ".join(listener.receives) or "nothing")
    waiting = tf2_ros.MessageFilter(None, buffer, "map", 10, node=node)
    passed, changes, done, begun, awaited = [], [], [], [], []
    waiting.registerCallback(passed.append)
    point = PointStamped()
    point.header.frame_id = "robot"
    waiting.add(point)
    buffer.on_change("map", "robot", changes.append)
    buffer.wait_for_transform_async("map", "robot", Time()).add_done_callback(done.append)

    class Transform:
        def __await__(self):
            steps = buffer.lookup_transform_async("map", "robot", Time()).__await__()
            yielded = next(steps)
            begun.append(True)  # the task sleeps
            yield yielded
            return (yield from steps)

    async def look_up():
        awaited.append(await Transform())

    task = executor.create_task(look_up)
    broadcaster = tf2_ros.TransformBroadcaster(sender)
    until(lambda: begun and sender.count_subscribers("/tf") > 0)
    broadcaster.sendTransform(transform("map", "robot", 1.0))
    buffer.lookup_transform("map", "robot", Time(), Duration(seconds=DEADLINE_S))
    str(listener)  # counts lost messages
    for name, what in {"filter": passed, "on_change": changes, "future": done, "await": awaited}.items():
        until(lambda what=what: what)
        print(name)
    until(task.done)
    asyncio.run(buffer.lookup_transform_async("map", "robot", Time()))
    server = tf2_ros.BufferServer(buffer, node, "lookup")
    client = tf2_ros.BufferClient(sender, "lookup")
    client.lookup_transform("map", "robot", Time(), DEADLINE_S)
    print("server and client")
    tf2_ros.StaticTransformBroadcaster(sender).sendTransform(transform("robot", "arm"))
    hidden = tf2_ros.Buffer()
    with tf2_ros.TransformListener(hidden):
        hidden.lookup_transform("robot", "arm", Time(), DEADLINE_S)
    spun = tf2_ros.Buffer()
    with tf2_ros.TransformListener(spun, sender, spin_thread=True):
        spun.lookup_transform("robot", "arm", Time(), DEADLINE_S)
    print("threads of listeners")
    client.destroy()
    server.destroy()
    listener.unregister()
    shut_down(executor, thread)
    rclpy.shutdown()


main()
