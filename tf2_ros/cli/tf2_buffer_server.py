"""Owns the program that receives transforms and answers lookups of other processes."""

import sys

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from tf2_ros.buffer import Buffer
from tf2_ros.buffer_server import BufferServer
from tf2_ros.transform_listener import TransformListener

__all__ = ["main"]

DEFAULT_BUFFER_SIZE_S = 120.0


def main(args: list[str] | None = None) -> int:
    """
    Serve until interrupted.

    :param args: of the command line, with its program name. None: those of the process.
    :return: the exit status.
    """
    rclpy.init(args=args)
    try:
        node = rclpy.create_node("tf_buffer")
        buffer_size_s = _buffer_size_s(node)
        if not buffer_size_s >= 0.0:
            print(f"buffer_size must not be negative, it is {buffer_size_s} s", file=sys.stderr)
            return 1
        buffer = Buffer(Duration(seconds=buffer_size_s), node)
        with TransformListener(buffer, node):
            server = BufferServer(buffer, node, "tf2_buffer_server")
            _spin(node)
            server.destroy()
        node.destroy_node()
        return 0
    finally:
        rclpy.try_shutdown()


def _buffer_size_s(node: Node) -> float:
    description = ParameterDescriptor(
        description="how far each frame's history reaches back, in seconds", read_only=True
    )
    size: float = node.declare_parameter("buffer_size", DEFAULT_BUFFER_SIZE_S, description).value
    return size


def _spin(node: Node) -> None:
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return  # that is how it ends


if __name__ == "__main__":
    sys.exit(main())
