# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Uses all of tf2_ros with an rclpy that differs from those that are known, and prints what worked.

Arguments: what is missing, ``functions`` of rcl and ``attributes`` of rclpy's classes; nothing, or both.
"""

import asyncio
import builtins
import ctypes
import sys
import threading

if "functions" in sys.argv:

    class Lacking(ctypes.PyDLL):
        def __getitem__(self, name):
            return super().__getitem__(name.replace("rcl_take", "rcl_took"))

    ctypes.PyDLL = Lacking

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.executors import MultiThreadedExecutor
from rclpy.time import Time
from spinning_nodes import shut_down
from times_and_transforms import transform
from waiting import DEADLINE_S, until

import tf2_ros
from tf2_ros import _rclpy

UNKNOWN = {
    "_is_shutdown",
    "_tasks",
    "_pending_tasks",
    "_tasks_lock",
    "_task_lock",
    "_executor",
    "_entities",
    "_tg",
}

if "attributes" in sys.argv:
    _rclpy.getattr = lambda one, name, *default: (
        default[0] if name in UNKNOWN and default else builtins.getattr(one, name, *default)
    )
    _rclpy.hasattr = lambda one, name: name not in UNKNOWN and builtins.hasattr(one, name)


def main():
    rclpy.init()
    node, sender = rclpy.create_node("using"), rclpy.create_node("sending")
    executor = MultiThreadedExecutor(2)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    buffer = tf2_ros.Buffer(node=node)
    listener = tf2_ros.TransformListener(buffer, node)
    print("without an executor:", ", ".join(listener.receives) or "nothing")
    waiting = tf2_ros.MessageFilter(None, buffer, "map", 10, node=node)
    passed, changes, done, awaited = [], [], [], []
    waiting.registerCallback(passed.append)
    point = PointStamped()
    point.header.frame_id = "robot"
    waiting.add(point)
    buffer.on_change("map", "robot", changes.append)
    buffer.wait_for_transform_async("map", "robot", Time()).add_done_callback(done.append)

    async def look_up():
        awaited.append(await buffer.lookup_transform_async("map", "robot", Time()))

    task = executor.create_task(look_up)
    broadcaster = tf2_ros.TransformBroadcaster(sender)
    until(lambda: sender.count_subscribers("/tf") > 0)
    broadcaster.sendTransform(transform("map", "robot", 1.0))
    buffer.lookup_transform("map", "robot", Time(), DEADLINE_S)
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
