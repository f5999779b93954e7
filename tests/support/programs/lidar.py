"""A lidar at 100 Hz whose transforms are published 50 ms late; arguments: how many of each."""

import sys
import threading
import time

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.time import Time
from sensor_msgs.msg import LaserScan

from tf2_ros import TransformBroadcaster

PERIOD_NS = 10_000_000
LATE = 5  # periods
BEGIN_NS = 1_000_000_000
DEADLINE_S = 60.0


def transform(ns):
    message = TransformStamped()
    message.header.stamp = Time(nanoseconds=ns).to_msg()
    message.header.frame_id, message.child_frame_id = "map", "lidar"
    message.transform.translation.x = ns / 1e9
    return message


def scan(ns):
    message = LaserScan()
    message.header.stamp = Time(nanoseconds=ns).to_msg()
    message.header.frame_id = "lidar"
    return message


def wait_for_subscriber(publisher):
    deadline = time.monotonic() + DEADLINE_S
    while not publisher.get_subscription_count():
        if time.monotonic() > deadline:
            raise TimeoutError(f"there is no subscriber of {publisher.topic_name}")
        threading.Event().wait(0.005)


def main(scans, transforms):
    rclpy.init(args=[])
    node = rclpy.create_node("lidar")
    publisher = node.create_publisher(LaserScan, "scan", 1000)
    broadcaster = TransformBroadcaster(node)
    wait_for_subscriber(publisher)
    wait_for_subscriber(broadcaster.pub_tf)
    print("begins", flush=True)
    sys.stdin.readline()
    begun = time.monotonic_ns()
    for i in range(scans + LATE):
        threading.Event().wait(max(begun + i * PERIOD_NS - time.monotonic_ns(), 0) / 1e9)
        if i < scans:
            publisher.publish(scan(BEGIN_NS + i * PERIOD_NS))
        if LATE <= i < transforms + LATE:
            # Between two scans: each needs the transforms on both sides of it.
            broadcaster.sendTransform(transform(BEGIN_NS + (i - LATE) * PERIOD_NS + PERIOD_NS // 2))
    print("done", flush=True)
    sys.stdin.readline()
    rclpy.shutdown()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
