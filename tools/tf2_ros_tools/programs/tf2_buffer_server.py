# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Receive transforms, and answer lookups of other processes."""

import sys
from argparse import Namespace
from functools import partial
from typing import Any, NoReturn

from tf2_ros_tools.common.program import (
    EXIT_STATUS,
    SUCCESS,
    Parser,
    UsageError,
    run,
    wait_until_interrupted,
)

DEFAULT_BUFFER_SIZE_S = 120.0


PARSER = Parser(
    "tf2_buffer_server",
    "Receive transforms, and answer the lookups of other processes through the action tf2_buffer_server, "
    "until interrupted. The parameter buffer_size sets how far each frame's history reaches back, in "
    "seconds; 120 by default.\n\n" + EXIT_STATUS,
    "  tf2_buffer_server --ros-args -p buffer_size:=30.0",
)


def serve(options: Namespace) -> NoReturn:
    """Serve until interrupted."""
    from tf2_ros_tools.nodes.node_session import spun_node

    from rcl_interfaces.msg import ParameterDescriptor

    from tf2_ros import Buffer, BufferServer, TransformListener

    summary = "how far each frame's history reaches back, in seconds"
    with spun_node("tf_buffer", options) as node:
        description = ParameterDescriptor(description=summary, read_only=True)
        parameter: Any = node.declare_parameter("buffer_size", DEFAULT_BUFFER_SIZE_S, description)
        if not parameter.value >= 0.0:
            raise UsageError(f"buffer_size: expected 0 or more, got {parameter.value} s")
        buffer = Buffer(parameter.value, node)
        with TransformListener(buffer, node):
            server = BufferServer(buffer, node, "tf2_buffer_server")
            try:
                wait_until_interrupted()
            finally:
                server.destroy()


main = partial(run, PARSER, serve, interrupted=SUCCESS)

if __name__ == "__main__":
    sys.exit(main())
