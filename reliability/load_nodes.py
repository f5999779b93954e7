# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run nodes that broadcast, and listen to all others: one process of the load of `tests_under_load`."""

import os
import sys
import threading

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import MultiThreadedExecutor

from tf2_ros import Buffer, TransformBroadcaster, TransformListener

PERIOD_S = 0.1


class Robot:
    """A node that broadcasts a frame and looks all others up."""

    def __init__(self, name):
        self.node = rclpy.create_node(name)
        self.buffer = Buffer(node=self.node)
        self.listener = TransformListener(self.buffer, self.node)
        self.broadcaster = TransformBroadcaster(self.node)
        self.timer = self.node.create_timer(PERIOD_S, self.step)

    def step(self):
        pose = TransformStamped(child_frame_id=self.node.get_name())
        pose.header.frame_id = "map"
        pose.header.stamp = self.node.get_clock().now().to_msg()
        pose.transform.rotation.w = 1.0
        self.broadcaster.sendTransform(pose)
        for frame in self.buffer.frames():
            self.buffer.can_transform("map", frame, rclpy.time.Time())


def main(number, count):
    rclpy.init()
    executor = MultiThreadedExecutor(2)
    robots = [Robot(f"busy_{number}_{i}") for i in range(int(count))]
    for robot in robots:
        executor.add_node(robot.node)
    # At once, because nobody reads what a shutdown amid all this would print.
    threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0))).start()
    executor.spin()


if __name__ == "__main__":
    main(*sys.argv[1:])
