# PYTHON_ARGCOMPLETE_OK
"""Owns the command line of the program that says whether the transforms of a robot are as they must be."""

from tf2_ros_cython.cli._checks import add_check_options
from tf2_ros_cython.cli._numbers import positive_number
from tf2_ros_cython.cli._program import Parser, run

__all__ = ["main"]


def parser() -> Parser:
    """Its command line."""
    made = Parser(
        "tf2_check",
        "Listen to transforms for a while, and print what is wrong with them, one line each: no transform at "
        "all, unconnected trees, loops, frames with two parents or two publishers, frames that are no longer "
        "published, gaps, stamps in the future, and what differs from a file of expectations. The exit "
        "status is 0 if nothing is wrong, otherwise 1.",
        "  tf2_check -t 10 --expect robot.yaml --junit transforms.xml",
    )
    made.add_argument(
        "-t", type=positive_number, metavar="S", default=5.0, help="listen for S seconds; 5 by default"
    )
    add_check_options(made)
    return made


def main(args: list[str] | None = None) -> int:
    """Run the program; see :func:`tf2_ros_cython.cli._program.run`."""
    return run(parser(), "tf2_ros.cli.tf2_check:check", args)
