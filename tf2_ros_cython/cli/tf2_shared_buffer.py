# PYTHON_ARGCOMPLETE_OK
"""Owns the command line of the program that listens for all processes of a machine."""

from tf2_ros_cython.cli._numbers import non_negative_number
from tf2_ros_cython.cli._program import Parser, run

__all__ = ["main"]

DESCRIPTION = """\
Receive transforms, and share the buffer that holds them with all processes of this user on this machine, \
until interrupted. One that is started with TF2_SHARED_BUFFER=auto in its environment, or =NAME, then reads \
this buffer instead of listening itself.

The log says what is shared; tf2_which says what a program would find."""

EXAMPLE = """\
  tf2_shared_buffer                                      by the name auto: one for each ROS domain
  tf2_shared_buffer --name simulated --cache-time 30 --ros-args -p use_sim_time:=true"""


def parser() -> Parser:
    """Its command line."""
    made = Parser("tf2_shared_buffer", DESCRIPTION, EXAMPLE)
    made.add_argument(
        "--name",
        metavar="NAME",
        default="auto",
        help="of the shared buffer; by default auto: by the ROS domain",
    )
    made.add_argument(
        "--cache-time",
        type=non_negative_number,
        metavar="S",
        help="how far each frame's history reaches back, in seconds; by default as of any buffer: 10",
    )
    return made


def main(args: list[str] | None = None) -> int:
    """Run the program; see :func:`tf2_ros_cython.cli._program.run`."""
    return run(parser(), "tf2_ros.cli.tf2_shared_buffer:share", args)
