"""Forks children after rclpy has installed its signal handlers; each spins a node of its own, and exits."""

import os
import sys

import rclpy

from tf2_ros import Buffer, TransformListener

rclpy.init()
for _ in range(int(sys.argv[1])):
    child = os.fork()
    if child == 0:
        context = rclpy.Context()
        context.init()
        node = rclpy.create_node("child", context=context)
        listener = TransformListener(Buffer(), node, spin_thread=True)
        context.shutdown()
        sys.exit()
    os.waitpid(child, 0)
rclpy.shutdown()
