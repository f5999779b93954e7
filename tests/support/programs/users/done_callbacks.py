# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is done when a transform arrives runs in the thread that spins, and not beside other callbacks."""

import threading
import time

import rclpy
from geometry_msgs.msg import TransformStamped

import tf2_ros

DEADLINE = time.monotonic() + 60.0

rclpy.init()
node = rclpy.create_node("waiting")
sender = rclpy.create_node("sending")
buffer = tf2_ros.Buffer()
listener = tf2_ros.TransformListener(buffer, node)
broadcaster = tf2_ros.TransformBroadcaster(sender)
transform = TransformStamped()
transform.header.frame_id = "map"
transform.child_frame_id = "robot"
transform.transform.rotation.w = 1.0

threads, is_working, found_working = [], [False], []


def on_transform(future):
    threads.append(threading.current_thread() is threading.main_thread())
    found_working.append(is_working[0])


def work():
    is_working[0] = True
    broadcaster.sendTransform(transform)
    time.sleep(0.3)  # computes something
    is_working[0] = False


future = buffer.wait_for_transform_async("map", "robot", rclpy.time.Time())
future.add_done_callback(on_transform)
node.create_timer(0.1, work)
while not threads and time.monotonic() < DEADLINE:
    rclpy.spin_once(node, timeout_sec=0.1)

print("in the main thread:", threads)
print("beside the callback of the timer:", found_working)

rclpy.shutdown()
