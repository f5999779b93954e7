"""Receive transforms, and answer lookups of other processes."""

from __future__ import annotations

import sys
from argparse import Namespace
from functools import partial
from typing import TYPE_CHECKING, Any, NoReturn

from tf2_ros_tools.program import SUCCESS, Parser, UsageError, run

if TYPE_CHECKING:
    from rclpy.duration import Duration
    from rclpy.node import Node

__all__ = ["main"]

DEFAULT_BUFFER_SIZE_S = 120.0


PARSER = Parser(
    "tf2_buffer_server",
    "Receive transforms, and answer the lookups of other processes through the action tf2_buffer_server, "
    "until interrupted. The parameter buffer_size sets how far each frame's history reaches back, in "
    "seconds; 120 by default.",
    "  tf2_buffer_server --ros-args -p buffer_size:=30.0",
)


def serve(options: Namespace) -> NoReturn:
    """Serve until interrupted."""
    from tf2_ros_tools.listening import spun_node, wait

    from tf2_ros import Buffer, BufferServer, TransformListener

    with spun_node("tf_buffer", options) as node:
        buffer = Buffer(_buffer_size(node), node)
        with TransformListener(buffer, node):
            server = BufferServer(buffer, node, "tf2_buffer_server")
            try:
                wait()
            finally:
                server.destroy()


def _buffer_size(node: Node) -> Duration:
    from tf2_ros_tools.listening import FOR_EVER

    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.duration import Duration

    description = ParameterDescriptor(
        description="how far each frame's history reaches back, in seconds", read_only=True
    )
    parameter: Any = node.declare_parameter("buffer_size", DEFAULT_BUFFER_SIZE_S, description)
    size: float = parameter.value
    if not size >= 0.0:
        raise UsageError(f"buffer_size: expected 0 or more, got {size} s")
    return FOR_EVER if size >= FOR_EVER.nanoseconds * 1e-9 else Duration(seconds=size)


main = partial(run, PARSER, serve, interrupted=SUCCESS)

if __name__ == "__main__":
    sys.exit(main())
