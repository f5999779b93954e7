# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A node of the tutorial's kind: a timer looks up where the other turtle is, and steers."""

import math
import sys

import rclpy
from geometry_msgs.msg import TransformStamped, Twist
from rclpy.node import Node
from rclpy.time import Time

from tf2_ros import TransformException
from tf2_ros.buffer import Buffer
from tf2_ros.transform_broadcaster import TransformBroadcaster
from tf2_ros.transform_listener import TransformListener

STEPS = 5
PATIENCE = 60.0  # seconds


class TurtleDriver(Node):
    """Publishes the poses of two turtles, one step after the other."""

    def __init__(self):
        super().__init__("turtle_driver")
        self.tf_broadcaster = TransformBroadcaster(self)

    def has_listener(self):
        return self.tf_broadcaster.pub_tf.get_subscription_count() > 0

    def publish(self, step):
        for name, x, y, theta in (
            ("turtle1", 2.0 + step, 5.0, 0.25 * step),
            ("turtle2", 1.0, 1.0 + 0.5 * step, math.pi / 2),
        ):
            t = TransformStamped()
            t.header.stamp.sec = 100 + step
            t.header.frame_id = "world"
            t.child_frame_id = name
            t.transform.translation.x = x
            t.transform.translation.y = y
            t.transform.rotation.z = math.sin(theta / 2)
            t.transform.rotation.w = math.cos(theta / 2)
            self.tf_broadcaster.sendTransform(t)


class FrameListener(Node):
    def __init__(self, driver):
        super().__init__("turtle_tf2_frame_listener")
        self.target_frame = self.declare_parameter("target_frame", "turtle1").value
        self.tf_buffer = Buffer()
        self.tf_listener = TransformListener(self.tf_buffer, self)
        self.driver = driver
        self.step = 0
        self.was_sent = False
        self.started = self.get_clock().now()
        self.timer = self.create_timer(0.02, self.on_timer)

    def on_timer(self):
        if (self.get_clock().now() - self.started).nanoseconds > PATIENCE * 1e9:
            sys.exit(f"gave up at step {self.step}")
        if not self.was_sent:
            if self.driver.has_listener():
                self.driver.publish(self.step)
                self.was_sent = True
            return
        try:
            t = self.tf_buffer.lookup_transform("turtle2", self.target_frame, Time(seconds=100 + self.step))
        except TransformException as ex:
            self.get_logger().info(f"Could not transform turtle2 to {self.target_frame}: {ex}")
            return
        self.steer(t.transform.translation)
        self.step += 1
        self.was_sent = False
        if self.step == STEPS:
            raise SystemExit

    def steer(self, offset):
        msg = Twist()
        msg.angular.z = math.atan2(offset.y, offset.x)
        msg.linear.x = 0.5 * math.hypot(offset.x, offset.y)
        print(f"step {self.step}: forward {msg.linear.x:.3f}, turn {msg.angular.z:+.3f}")


def main():
    rclpy.init()
    driver = TurtleDriver()
    node = FrameListener(driver)
    try:
        rclpy.spin(node)
    except SystemExit as end:
        if end.code:
            raise
    print("done")
    node.destroy_node()
    driver.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
