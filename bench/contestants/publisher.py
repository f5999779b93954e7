"""A node that publishes a tree's frames as a robot would, until its standard input ends."""

import sys
import threading
import time

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros2_tf2 import S, fill
from serving import Tree

from tf2_msgs.msg import TFMessage

PERIOD_S = 0.01


def wait_for_end_of_input(ended):
    sys.stdin.read()
    ended.set()


def main(path):
    tree = Tree(path)
    latest = {}
    for child, parent, static, _, pose in tree.records():
        latest[child] = static, parent, pose
    still = [
        fill(TransformStamped(), child, parent, 0, pose)
        for child, (static, parent, pose) in latest.items()
        if static
    ]
    moving = [
        fill(TransformStamped(), child, parent, 0, pose)
        for child, (static, parent, pose) in latest.items()
        if not static
    ]
    rclpy.init()
    node = rclpy.create_node("bench_publisher")
    lasting = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(TFMessage, "/tf_static", lasting).publish(TFMessage(transforms=still))
    publisher = node.create_publisher(TFMessage, "/tf", 100)
    ended = threading.Event()
    threading.Thread(target=wait_for_end_of_input, args=(ended,), daemon=True).start()
    due = time.monotonic()
    while not ended.is_set():
        now_ns = time.time_ns()
        for transform in moving:
            transform.header.stamp.sec, transform.header.stamp.nanosec = divmod(now_ns, S)
        publisher.publish(TFMessage(transforms=moving))
        due += PERIOD_S
        ended.wait(max(0.0, due - time.monotonic()))
    rclpy.shutdown()


if __name__ == "__main__":
    main(sys.argv[1])
