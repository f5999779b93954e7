"""
Shares what it receives, and says so, until it is killed.

`shares_what_it_receives.py NAME`, with arguments for ROS.
"""

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
