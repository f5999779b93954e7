"""A program gives its listener another buffer while it runs."""

import time

import rclpy
from geometry_msgs.msg import TransformStamped

import tf2_ros

DEADLINE = time.monotonic() + 60.0


def fill(buffer, child):
    transform.child_frame_id = child
    while not buffer._frameExists(child) and time.monotonic() < DEADLINE:
        broadcaster.sendTransform(transform)
        rclpy.spin_once(node, timeout_sec=0.05)
    return buffer._frameExists(child)


rclpy.init()
node = rclpy.create_node("swapping")
first, second = tf2_ros.Buffer(), tf2_ros.Buffer()
listener = tf2_ros.TransformListener(first, node)
broadcaster = tf2_ros.TransformBroadcaster(node)
transform = TransformStamped()
transform.header.frame_id = "map"
transform.transform.rotation.w = 1.0

print("the first buffer was filled:", fill(first, "before"))
listener.buffer = second
print("the second buffer was filled:", fill(second, "after"))
print("the first one too:", first._frameExists("after"))

rclpy.shutdown()
