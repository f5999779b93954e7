"""Owns the program that receives transforms and answers lookups of other processes."""

import sys
from typing import Any

from tf2_ros_cython.cli.tf2_buffer_server import main

if __name__ == "__main__":  # before what needs ROS: `main` says in one line what is missing
    sys.exit(main())

from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

from argparse import Namespace
from contextlib import suppress

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.duration import Duration
from rclpy.node import Node

from tf2_ros._times import FOR_EVER
from tf2_ros.buffer import Buffer
from tf2_ros.buffer_server import BufferServer
from tf2_ros.cli._node import spun_node
from tf2_ros.transform_listener import TransformListener
from tf2_ros_cython.cli._program import SUCCESS, UsageError, deferred_signals, wait_for_signal

__all__ = ["main", "serve"]

DEFAULT_BUFFER_SIZE_S = 120.0


def serve(options: Namespace) -> int:
    """Serve until interrupted; return the exit status."""
    with suppress(KeyboardInterrupt), spun_node("tf_buffer", options) as node, deferred_signals():
        buffer = Buffer(_buffer_size(node), node)
        with TransformListener(buffer, node):
            server = BufferServer(buffer, node, "tf2_buffer_server")
            wait_for_signal()
            server.destroy()
    return SUCCESS


def _buffer_size(node: Node) -> Duration:
    description = ParameterDescriptor(
        description="how far each frame's history reaches back, in seconds", read_only=True
    )
    parameter: Any = node.declare_parameter("buffer_size", DEFAULT_BUFFER_SIZE_S, description)
    size: float = parameter.value
    if not size >= 0.0:
        raise UsageError(f"buffer_size must not be negative, it is {size} s")
    return FOR_EVER if size >= FOR_EVER.nanoseconds * 1e-9 else Duration(seconds=size)
