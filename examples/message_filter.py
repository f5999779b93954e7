# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A lidar whose transforms arrive late: a message filter passes each scan once its transform is available.

Run: ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID=42 python examples/message_filter.py
Without the variables (on Humble, ROS_LOCALHOST_ONLY=1 and a domain), it would publish to your whole network.
Ends by itself. The exit status is 0 only if every scan passed, in order.
"""

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.task import Future
from rclpy.time import Time
from sensor_msgs.msg import LaserScan

from tf2_ros import Buffer, MessageFilter, TransformBroadcaster, TransformListener

SCANS = 20
PERIOD_S = 0.05
DELAY = 4  # of the transforms, in periods
LIMIT_S = 60.0


def main():
    rclpy.init()
    node = rclpy.create_node("mapping")
    buffer = Buffer(node=node)
    passed, done = [], Future()

    def on_scan(scan):
        stamp = Time.from_msg(scan.header.stamp)
        found = buffer.lookup_transform("map", scan.header.frame_id, stamp)
        passed.append(stamp.nanoseconds)
        x = found.transform.translation.x
        print(f"scan of {stamp.nanoseconds / 1e9:.2f} s: the lidar was at x = {x:.2f} m")
        if len(passed) == SCANS:
            done.set_result(True)

    def on_failure(scan, reason, text):
        print(f"a scan was dropped: {reason.value}: {text}")

    topic = (LaserScan, "scan", 10)
    scans = MessageFilter(topic, buffer, "map", 50, node=node, buffer_timeout=Duration(seconds=2))
    scans.registerCallback(on_scan)
    scans.registerFailureCallback(on_failure, with_text=True)
    with TransformListener(buffer, node):
        node.create_timer(PERIOD_S, Lidar(node).tick)
        rclpy.spin_until_future_complete(node, done, timeout_sec=LIMIT_S)
    scans.close()
    print(scans.statistics())
    rclpy.shutdown()
    return 0 if done.done() and passed == sorted(passed) else 1


class Lidar:
    """Sends scans, and each scan's transform DELAY periods later."""

    def __init__(self, node):
        self.scans = node.create_publisher(LaserScan, "scan", 10)
        self.transforms = TransformBroadcaster(node)
        self.ticks = 0

    def tick(self):
        if not (self.scans.get_subscription_count() and self.transforms.pub_tf.get_subscription_count()):
            return  # no subscriber would receive
        if self.ticks < SCANS:
            scan = LaserScan()
            scan.header.frame_id = "lidar"
            scan.header.stamp = stamp(self.ticks)
            self.scans.publish(scan)
        if DELAY <= self.ticks < DELAY + SCANS:
            transform = TransformStamped()
            transform.header.frame_id = "map"
            transform.child_frame_id = "lidar"
            transform.header.stamp = stamp(self.ticks - DELAY)
            transform.transform.translation.x = 0.1 * (self.ticks - DELAY)
            self.transforms.sendTransform(transform)
        self.ticks += 1


def stamp(tick):
    """The time of a tick; the first one is at 1 s."""
    return Time(nanoseconds=round((1 + tick * PERIOD_S) * 1e9)).to_msg()


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except KeyboardInterrupt:
        raise SystemExit(130) from None
