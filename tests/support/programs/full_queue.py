"""Ends while the messages of a message filter still wait."""

import sys

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.duration import Duration

from tf2_ros import Buffer, MessageFilter


def main(how):
    rclpy.init()
    node = rclpy.create_node("ending")
    buffer = Buffer(node=node)
    topic = (PointStamped, "points", 10)
    timeout = Duration(seconds=60)
    waiting = MessageFilter(topic, buffer, "map", 100, node=node, buffer_timeout=timeout)
    for _ in range(100):
        message = PointStamped()
        message.header.frame_id = "lidar"
        waiting.add(message)
    assert waiting.statistics()["waiting"] == 100
    if how == "shutdown":
        rclpy.shutdown()
    elif how == "node":
        node.destroy_node()
    elif how == "close":
        waiting.close()
    print("at the end", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
