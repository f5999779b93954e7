# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Serves lookups in the buffer of a listener until it is killed. Its argument is the name of the action."""

import sys

import rclpy

from tf2_ros import Buffer, BufferServer, TransformListener

rclpy.init()
node = rclpy.create_node("serving")
buffer = Buffer(node=node)
listener = TransformListener(buffer, node)
server = BufferServer(buffer, node, sys.argv[1])
rclpy.spin(node)
