"""Waits in vain in all ways, for longer than a second each, and at last ends."""

import sys
import threading

import rclpy
from geometry_msgs.msg import PointStamped, TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time

from tf2_ros import Buffer, MessageFilter, TransformException

LONG = Duration(seconds=2.5)


def main():
    rclpy.init()
    node = rclpy.create_node("waiting")
    buffer = Buffer(node=node)
    transform = TransformStamped(child_frame_id="robot")
    transform.header.frame_id, transform.header.stamp.sec = "map", 1
    transform.transform.rotation.w = 1.0
    buffer.set_transform(transform, "test")
    filter = MessageFilter(None, buffer, "map", 10, node=node)
    filter.add(point("lidar"))
    future = buffer.wait_for_transform_async("map", "robot", Time(seconds=5), timeout=LONG)
    ended = buffer.wait_for_transform_async("map", "ended", Time())
    ended.cancel()
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    try:
        buffer.lookup_transform("map", "arm", Time(), LONG)
    except TransformException:
        done.wait()
        future.exception()
    print("ended", file=sys.stderr, flush=True)


def point(frame):
    message = PointStamped()
    message.header.frame_id = frame
    return message


if __name__ == "__main__":
    main()
