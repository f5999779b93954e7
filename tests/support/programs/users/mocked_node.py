# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Unit tests of a program that give it a mock in the place of a node."""

from unittest.mock import MagicMock, Mock, patch

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

import tf2_ros

node = MagicMock()
tf2_ros.TransformBroadcaster(node).sendTransform(TransformStamped(child_frame_id="robot"))
[message] = node.create_publisher.return_value.publish.call_args.args
print("published:", type(message).__name__, message.transforms[0].child_frame_id)

listener = tf2_ros.TransformListener(tf2_ros.Buffer(node=node), MagicMock())
listener.callback(MagicMock(transforms=[]))
listener.unregister()
print("listener of a mock:", type(listener).__name__)

buffer = MagicMock(spec=tf2_ros.Buffer)
listener = tf2_ros.TransformListener(buffer, Mock(spec=Node))
listener.callback(MagicMock(transforms=["a transform"]))
listener.unregister()
print("inserted:", buffer.set_transform.call_args.args)

rclpy.init()
node = rclpy.create_node("patched")
with patch("rclpy.node.Node.create_subscription") as create_subscription:
    listener = tf2_ros.TransformListener(tf2_ros.Buffer(), node)
    listener.unregister()
print("subscriptions:", create_subscription.call_count)
rclpy.shutdown()
