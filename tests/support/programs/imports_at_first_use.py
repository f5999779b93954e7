# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Uses a buffer in every way for the first time; prints the modules that this imported."""

import asyncio
import json
import sys

import rclpy
from rclpy.duration import Duration
from rclpy.time import Time
from times_and_transforms import transform

import tf2_ros

SHORT = Duration(seconds=0.01)


def failing(look_up, *arguments, **others):
    try:
        look_up(*arguments, **others)
    except (tf2_ros.TransformException, TypeError):
        return
    raise AssertionError("it did not fail")


async def follow(buffer):
    await buffer.lookup_transform_async("map", "robot", Time())
    async for _ in buffer.changes("map", "robot"):
        return


def use(buffer, listener, client, waiting):
    seen = []
    buffer.on_change("map", "robot", lambda change: seen.append(tf2_ros.format_transform(change)))
    future = buffer.wait_for_transform_async("map", "robot", Time())
    future.add_done_callback(seen.append)
    waiting.add(transform("map", "robot", 1))
    for seconds in (1, 2):
        buffer.set_transform(transform("map", "robot", seconds), "me")
    buffer.set_transform_static(transform("map", "camera"), "me")
    failing(buffer.lookup_transform, "map", "robots", Time())
    failing(buffer.lookup_transform, "map", "robot", Time(seconds=9), SHORT)
    failing(buffer.lookup_transform, "map", "robot", "now")
    failing(buffer.lookup_transforms, "map", "robot", [9 * 10**9])
    failing(client.lookup_transform, "map", "robot", Time(), SHORT)
    buffer.lookup_transform("map", "robot", Time(seconds=9), tolerance=10)
    buffer.lookup_transform_full("map", Time(), "robot", Time(), "map")
    buffer.lookup_transforms("map", "robot", [10**9])
    buffer.lookup_matrix("map", "robot", 10**9)
    buffer.can_transform("map", "nowhere", Time(), SHORT, return_debug_tuple=True)
    buffer.get_latest_common_time("map", "robot")
    buffer.set_transform(transform("map", "map", 1), "me")  # logs that this is refused
    str((buffer.frames(), buffer.histories(), buffer.all_frames_as_yaml(), buffer.statistics()))
    repr((buffer, listener, client, waiting, future))
    asyncio.run(follow(buffer))
    while len(seen) < 2:
        rclpy.spin_once(listener.node, timeout_sec=0.1)


def main():
    rclpy.init()
    node = rclpy.create_node("first")
    buffer = tf2_ros.Buffer(node=node)
    listener = tf2_ros.TransformListener(buffer, node)
    client = tf2_ros.BufferClient(node, "nobody")
    with tf2_ros.MessageFilter(None, buffer, "map", 10, node=node) as waiting:
        rclpy.spin_once(node, timeout_sec=0)
        asyncio.run(asyncio.sleep(0))  # what others import is not looked at
        before = set(sys.modules)
        use(buffer, listener, client, waiting)
        print(json.dumps(sorted(set(sys.modules) - before)), flush=True)
    client.destroy()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
