# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Receives one message from another node of this process, and prints what its listener counts as lost."""

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.time import Time

from tf2_ros import Buffer, StaticTransformBroadcaster, TransformListener

rclpy.init()
node, buffer = rclpy.create_node("hearing"), Buffer()
mount = TransformStamped(child_frame_id="camera")
mount.header.frame_id = "base"
broadcaster = StaticTransformBroadcaster(rclpy.create_node("sending"))
broadcaster.sendTransform(mount)
with TransformListener(buffer, node) as listener:
    buffer.lookup_transform("base", "camera", Time(), 60.0)
    print("lost:", listener._tf2_state.topics[1].lost())
rclpy.shutdown()
