# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A program replaces a listener's subscriptions, and has subscriptions of its own in the listener's group."""

import time

import rclpy
from geometry_msgs.msg import TransformStamped
from std_msgs.msg import String

import tf2_ros
from tf2_msgs.msg import TFMessage

DEADLINE = time.monotonic() + 60.0


def spin_until(condition, publish):
    while not condition() and time.monotonic() < DEADLINE:
        publish()
        rclpy.spin_once(node, timeout_sec=0.05)
    return condition()


def message(child):
    transform = TransformStamped()
    transform.header.frame_id = "map"
    transform.child_frame_id = child
    transform.transform.rotation.w = 1.0
    return TFMessage(transforms=[transform])


rclpy.init()
node = rclpy.create_node("listening")
buffer = tf2_ros.Buffer()
listener = tf2_ros.TransformListener(buffer, node)

# Another topic, with the listener's method.
node.destroy_subscription(listener.tf_sub)
listener.tf_sub = node.create_subscription(
    TFMessage, "/robot/tf", listener.callback, 100, callback_group=listener.group
)
robot = node.create_publisher(TFMessage, "/robot/tf", 100)
print("another topic:", spin_until(lambda: buffer._frameExists("arm"), lambda: robot.publish(message("arm"))))

# Another topic, with everything that the subscription had.
before = listener.tf_sub
node.destroy_subscription(before)
listener.tf_sub = node.create_subscription(before.msg_type, "/mocap/tf", before.callback, before.qos_profile)
mocap = node.create_publisher(TFMessage, "/mocap/tf", 100)
print("its callback:", spin_until(lambda: buffer._frameExists("cup"), lambda: mocap.publish(message("cup"))))

# The group is one like others.
heard = []
node.create_subscription(String, "words", heard.append, 10, callback_group=listener.group)
words = node.create_publisher(String, "words", 10)
print("its group:", spin_until(lambda: bool(heard), lambda: words.publish(String(data="hello"))))

rclpy.shutdown()
