# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correct the past of a node's buffer while a SLAM publishes a path that grows, and close a loop.

Another process is the robot: it drives 3 m along x, but its odometry measures 3.3 m. Its SLAM publishes the
poses at its keyframes as a nav_msgs/Path, twice a second, as the odometry has them. Then it closes a loop,
and all poses of the last path are right. Here, `PathCorrector` corrects its buffer with each path, and a
message filter passes each scan once the path reaches beyond it. The last scans wait for the path that closes
the loop.

Run: ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID=42 python examples/correct_past.py
Without the variables (on Humble, ROS_LOCALHOST_ONLY=1 and a domain), it would publish to your whole network.
Ends by itself. The exit status is 0 only if, in the end, each scan was where the last path says.
"""

import subprocess
import sys
import time
from contextlib import contextmanager, suppress

import rclpy
from builtin_interfaces.msg import Time as Stamp
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Path
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import LaserScan

from tf2_ros import Buffer, MessageFilter, TransformBroadcaster, TransformListener
from tf2_ros.correction import correct

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PERIOD_S = 0.05  # of the odometry
KEYFRAME, SCAN, LAST = 10, 5, 60  # periods: between keyframes, between scans, and of the drive
SCANS = range(KEYFRAME + SCAN // 2, LAST, SCAN)  # the first odometry may be lost
LIMIT_S = 60.0


class PathCorrector(Node):
    """Has a buffer whose past agrees with the latest path."""

    def __init__(self) -> None:
        super().__init__("path_corrector")
        self.buffer = Buffer(Duration(seconds=600), self)
        self.listener = TransformListener(self.buffer, self)
        self.create_subscription(Path, "slam/path", self.on_path, LATCHED)
        self.path = Path()  # the latest one

    def on_path(self, path: Path) -> None:
        times = [pose.header.stamp for pose in path.poses]
        # Keyframes before this node was started are skipped. What is newer than the last one is not in the
        # map yet, so that a message filter waits for the next path.
        used = correct(
            self.buffer,
            path.header.frame_id,
            "odom",
            "base_link",
            times,
            path.poses,
            after="keep",
            on_missing="skip",
        )
        self.get_logger().info(f"{used} of {len(times)} keyframes correct the past")
        self.path = path


def main() -> int:
    rclpy.init()
    node = PathCorrector()
    passed: list[tuple[Time, float]] = []  # the scans, and where they were when they passed the filter

    def x_at(stamp: Time) -> float:
        return node.buffer.lookup_transform("map", "base_link", stamp).transform.translation.x

    def on_scan(scan: LaserScan) -> None:
        stamp = Time.from_msg(scan.header.stamp)
        passed.append((stamp, x_at(stamp)))

    topic = (LaserScan, "scan", 50)
    waiting = MessageFilter(topic, node.buffer, "map", 50, node=node)
    waiting.registerCallback(on_scan)
    end = time.monotonic() + LIMIT_S
    with running_robot():
        while len(passed) < len(SCANS) and time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=1.0)
    waiting.close()
    is_right = len(passed) == len(SCANS)
    for stamp, x in passed:
        now, first = x_at(stamp), node.path.poses[0]
        driven = (stamp - Time.from_msg(first.header.stamp)).nanoseconds / 1e9  # at 1 m/s
        is_right = is_right and abs(now - first.pose.position.x - driven) < 1e-6
        print(f"a scan was at x = {x:.3f} m when it passed the filter, and is at x = {now:.3f} m now")
    rclpy.shutdown()
    return 0 if is_right else 1


# The robot.


@contextmanager
def running_robot():
    # In a separate session, so that Ctrl-C reaches only this program, which then ends the robot.
    robot = subprocess.Popen([sys.executable, __file__, "drive"], start_new_session=True)
    try:
        yield
    finally:
        robot.terminate()
        robot.wait()


class Robot(Node):
    """Drives, scans, and knows too late how far it has come."""

    def __init__(self) -> None:
        super().__init__("robot")
        self.broadcaster = TransformBroadcaster(self)
        self.scans = self.create_publisher(LaserScan, "scan", 50)
        self.paths = self.create_publisher(Path, "slam/path", LATCHED)
        self.start, self.step = self.get_clock().now(), 0
        self.create_timer(PERIOD_S, self.tick)

    def tick(self) -> None:
        readers = self.scans, self.paths, self.broadcaster.pub_tf
        if not all(one.get_subscription_count() for one in readers):
            self.start = self.get_clock().now()  # nobody would receive
            return
        if self.step > LAST:
            return
        transform = TransformStamped(child_frame_id="base_link")
        transform.header.frame_id = "odom"
        transform.header.stamp = self.stamp(self.step)
        transform.transform.translation.x = 1.1 * self.step * PERIOD_S
        self.broadcaster.sendTransform(transform)
        if self.step in SCANS:
            scan = LaserScan()
            scan.header.frame_id, scan.header.stamp = "base_link", self.stamp(self.step)
            self.scans.publish(scan)
        if self.step and self.step % KEYFRAME == 0:
            self.paths.publish(self.path(1.0 if self.step == LAST else 1.1))
        self.step += 1

    def path(self, scale: float) -> Path:
        path = Path()
        path.header.frame_id = "map"
        for step in range(KEYFRAME, self.step + 1, KEYFRAME):
            pose = PoseStamped()
            pose.header.stamp = self.stamp(step)
            pose.pose.position.x = scale * step * PERIOD_S
            path.poses.append(pose)
        return path

    def stamp(self, step: int) -> Stamp:
        return (self.start + Duration(seconds=step * PERIOD_S)).to_msg()


def drive() -> int:
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):  # the other process is done
        rclpy.spin(Robot())
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(drive() if sys.argv[1:] == ["drive"] else main())
