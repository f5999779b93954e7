"""Shares what it receives, and says so: `owner.py NAME`, with arguments for ROS. Runs until it is killed."""

import sys

import rclpy

from tf2_ros import Buffer, TransformListener


def main():
    rclpy.init()
    node = rclpy.create_node("owner")
    buffer = Buffer(node=node, share=sys.argv[1])
    with TransformListener(buffer, node):
        print("shared", flush=True)
        rclpy.spin(node)


main()
