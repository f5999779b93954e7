# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Asks a buffer server that is discovered in part, see `interposed/half_discovered_server.c`."""

import rclpy
from spinning_nodes import spun_node
from times_and_transforms import transform
from waiting import DEADLINE_S

from tf2_ros import Buffer, BufferClient, BufferServer

rclpy.init()
with spun_node("serving") as node:
    buffer = Buffer(node=node)
    buffer.set_transform(transform("map", "robot", 1), "test")
    server = BufferServer(buffer, node, "half_discovered")
    client = BufferClient(node, "half_discovered")
    print(client.lookup_transform("map", "robot", 1_000_000_000, DEADLINE_S).child_frame_id)
    client.destroy()
rclpy.shutdown()
