# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A coroutine of a lookup driven by hand: it answers with what is newest when it goes on."""

import rclpy
from geometry_msgs.msg import TransformStamped

import tf2_ros


def at(second):
    transform = TransformStamped()
    transform.header.frame_id = "map"
    transform.header.stamp.sec = second
    transform.child_frame_id = "robot"
    transform.transform.rotation.w = 1.0
    return transform


buffer = tf2_ros.Buffer()
lookup = buffer.lookup_transform_async("map", "robot", rclpy.time.Time())
lookup.send(None)
for second in (1, 2):
    buffer.set_transform(at(second), "example")
try:
    lookup.send(None)
except StopIteration as answer:
    print("latest is of second", answer.value.header.stamp.sec)
