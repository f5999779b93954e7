# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correct the past whenever a SLAM publishes its optimized path.

A robot drives 3 m along x, but its odometry measures 3.3 m. A SLAM closes a loop, and publishes the poses at
its keyframes as a nav_msgs/Path. With it, `PathCorrector` corrects the past of its buffer. That class is all
that a program of your own needs.

Run: python examples/correct_past.py
Ends by itself. The exit status is 0 only if the robot was where the path says.
"""

import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Path
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

from tf2_ros import Buffer, TransformBroadcaster, TransformListener
from tf2_ros.correction import correct

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class PathCorrector(Node):
    """Has a buffer whose past agrees with the latest path."""

    def __init__(self) -> None:
        super().__init__("path_corrector")
        self.buffer = Buffer(Duration(seconds=600), self)
        self.listener = TransformListener(self.buffer, self)
        self.create_subscription(Path, "slam/path", self.on_path, LATCHED)
        self.keyframes = 0  # used of the latest path

    def on_path(self, path: Path) -> None:
        times = [pose.header.stamp for pose in path.poses]
        # Those before this node was started are skipped.
        self.keyframes = correct(
            self.buffer, path.header.frame_id, "odom", "base_link", times, path.poses, on_missing="skip"
        )
        self.get_logger().info(f"{self.keyframes} of {len(times)} keyframes correct the past")


def odometry(start: Time) -> list[TransformStamped]:
    """Each 0.1 s for 3 s."""
    transforms = []
    for i in range(31):
        one = TransformStamped(child_frame_id="base_link")
        one.header.frame_id = "odom"
        one.header.stamp = (start + Duration(seconds=i / 10)).to_msg()
        one.transform.translation.x = 1.1 * i / 10
        transforms.append(one)
    return transforms


def optimized_path(start: Time) -> Path:
    path = Path()
    path.header.frame_id = "map"
    for second in range(4):
        pose = PoseStamped()
        pose.header.stamp = (start + Duration(seconds=second)).to_msg()
        pose.pose.position.x = float(second)
        path.poses.append(pose)
    return path


def main() -> int:
    rclpy.init()
    corrector, robot = PathCorrector(), rclpy.create_node("robot")
    broadcaster = TransformBroadcaster(robot)
    start = robot.get_clock().now()
    transforms = odometry(start)
    while not corrector.buffer.can_transform("odom", "base_link", transforms[-1].header.stamp):
        broadcaster.sendTransform(transforms)
        time.sleep(0.1)
    robot.create_publisher(Path, "slam/path", LATCHED).publish(optimized_path(start))
    while corrector.keyframes == 0:
        rclpy.spin_once(corrector)
    between = start + Duration(seconds=1.5)
    x = corrector.buffer.lookup_transform("map", "base_link", between).transform.translation.x
    print(f"Halfway, the robot was at x = {x:.3f} m")
    rclpy.shutdown()
    return 0 if abs(x - 1.5) < 1e-9 else 1


if __name__ == "__main__":
    sys.exit(main())
