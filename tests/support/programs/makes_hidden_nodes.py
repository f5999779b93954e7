# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A node, and all that makes hidden nodes beside it, until standard input ends."""

import sys

import rclpy

from tf2_ros import Buffer, BufferClient, TransformListener

rclpy.init()
node = rclpy.create_node("driver")
buffer = Buffer()
listeners = [TransformListener(buffer) for _ in range(2)]
client = BufferClient(node, "lookups")
sys.stdin.read()
rclpy.shutdown()
