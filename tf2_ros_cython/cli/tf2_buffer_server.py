# PYTHON_ARGCOMPLETE_OK
"""Owns the command line of the program that answers lookups of other processes."""

from tf2_ros_cython.cli._program import Parser, run

__all__ = ["main"]


def parser() -> Parser:
    """Its command line."""
    return Parser(
        "tf2_buffer_server",
        "Receive transforms, and answer the lookups of other processes through the action tf2_buffer_server, "
        "until interrupted. The parameter buffer_size is how far each frame's history reaches back, in "
        "seconds; 120 by default.",
        "  tf2_buffer_server --ros-args -p buffer_size:=30.0",
    )


def main(args: list[str] | None = None) -> int:
    """Run the program; see :func:`tf2_ros_cython.cli._program.run`."""
    return run(parser(), "tf2_ros.cli.tf2_buffer_server:serve", args)
