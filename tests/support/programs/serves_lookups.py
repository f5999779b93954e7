"""Serves lookups in an empty buffer until it is killed. Its argument is the name of the action."""

import sys

import rclpy

from tf2_ros import Buffer, BufferServer

rclpy.init()
node = rclpy.create_node("serving")
server = BufferServer(Buffer(node=node), node, sys.argv[1])
rclpy.spin(node)
