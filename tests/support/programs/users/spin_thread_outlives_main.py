# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The thread that a listener spins serves the whole node: after unregister(), and after the end of main."""

import threading

import rclpy

import tf2_ros

DEADLINE_S = 60.0

rclpy.init()
node = rclpy.create_node("spun")
listener = tf2_ros.TransformListener(tf2_ros.Buffer(), node, spin_thread=True)
ticked = threading.Event()
node.create_timer(0.05, ticked.set)
print("spun by the listener:", ticked.wait(DEADLINE_S))

listener.unregister()
for _ in range(3):
    ticked.clear()
    print("still spun after unregister():", ticked.wait(DEADLINE_S))

ticks = []


def tick():
    ticks.append(None)
    if len(ticks) == 5:
        print("ticked 5 times after main ended", flush=True)
        rclpy.shutdown()


node.create_timer(0.2, tick)
print("main ends", flush=True)
