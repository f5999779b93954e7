# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A subclass whose constructor does not call that of the listener; and calls of `__del__`."""

import rclpy

import tf2_ros
from tf2_msgs.msg import TFMessage


class PrefixedListener(tf2_ros.TransformListener):
    def __init__(self, buffer, node, prefix):
        self.buffer = buffer
        self.node = node
        self.tf_sub = node.create_subscription(TFMessage, prefix + "/tf", self.callback, 100)
        self.tf_static_sub = node.create_subscription(
            TFMessage, prefix + "/tf_static", self.static_callback, 100
        )


rclpy.init()
node = rclpy.create_node("listening")
buffer = tf2_ros.Buffer()

prefixed = PrefixedListener(buffer, node, "/robot")
print("topics:", prefixed.tf_sub.topic_name, prefixed.tf_static_sub.topic_name)
prefixed.unregister()
print("unregistered")

listener = tf2_ros.TransformListener(buffer, node)
listener.__del__()
print("TransformListener ended by hand")


class EndedBuffer(tf2_ros.Buffer):
    def __del__(self):
        super().__del__()
        print("Buffer ended")


ended = EndedBuffer()
del ended

rclpy.shutdown()
