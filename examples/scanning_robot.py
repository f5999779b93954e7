# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A robot that drives in a circle and scans twice a second, for 15 s: company for the node of the README.

Run: ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID=42 python examples/scanning_robot.py
Without the variables (on Humble, ROS_LOCALHOST_ONLY=1 and a domain), it would publish to your whole network.
As on a real robot, the pose at the stamp of a scan is published after the scan, so lookups have to wait.
"""

import math

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import LaserScan

from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

SCANS = 30
PERIOD_S = 0.5
RADIUS_M = 2.0
LIDAR_X_M = 0.2  # ahead of the center of the robot


def transform(parent: str, child: str, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> TransformStamped:
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.transform.translation.x, message.transform.translation.y = x, y
    message.transform.rotation.z, message.transform.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return message


class ScanningRobot(Node):
    def __init__(self) -> None:
        super().__init__("scanning_robot")
        self.scans = self.create_publisher(LaserScan, "scan", 10)
        self.moving = TransformBroadcaster(self)
        self.fixed = StaticTransformBroadcaster(self)
        self.fixed.sendTransform(transform("base_link", "lidar", x=LIDAR_X_M))
        self.count = 0
        self.create_timer(PERIOD_S, self.scan)

    def scan(self) -> None:
        if self.count == SCANS:
            raise SystemExit
        stamp = self.get_clock().now().to_msg()
        scan = LaserScan(angle_min=-1.5, angle_max=1.5, angle_increment=1.0, range_max=10.0)
        scan.ranges = [3.0, 3.0, 3.0, 3.0]
        scan.header.frame_id, scan.header.stamp = "lidar", stamp
        self.scans.publish(scan)
        angle = 0.2 * self.count
        x, y = RADIUS_M * math.cos(angle), RADIUS_M * math.sin(angle)
        pose = transform("map", "base_link", x, y, angle + math.pi / 2)
        pose.header.stamp = stamp
        self.moving.sendTransform(pose)
        self.count += 1


rclpy.init()
try:
    rclpy.spin(ScanningRobot())
except (KeyboardInterrupt, ExternalShutdownException):
    pass  # stopped with Ctrl-C
