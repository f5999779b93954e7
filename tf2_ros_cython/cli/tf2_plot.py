# PYTHON_ARGCOMPLETE_OK
"""Owns the command line of the program that draws transforms over time."""

from tf2_ros_cython.cli._endings import ending_in, listed
from tf2_ros_cython.cli._numbers import positive_number
from tf2_ros_cython.cli._plots import add_plot_options
from tf2_ros_cython.cli._program import Parser, run

__all__ = ["main"]

FORMATS = ("png", "svg")
SECONDS = 10.0

DESCRIPTION = """\
Listen to transforms for a while, and draw when each frame was received, with gaps, rates and delays. The \
name of the file is printed. With --path: the way of a frame in another one, from above, and its \
components over time.

Exit status: 0 if the picture was written, otherwise 1."""

EXAMPLE = """\
  tf2_plot                                 all frames, as tf2_plot_DATE.png
  tf2_plot odom base_link -t 30            two frames over 30 seconds
  tf2_plot --path map base_link -o way.svg"""


def parser() -> Parser:
    """Its command line."""
    made = Parser("tf2_plot", DESCRIPTION, EXAMPLE)
    add_plot_options(made)
    made.add_argument(
        "-t",
        type=positive_number,
        metavar="S",
        default=SECONDS,
        help=f"draw S seconds; {SECONDS:g} by default",
    )
    made.add_argument(
        "-o", "--output", metavar="FILE", type=ending_in(*FORMATS), help=f"ends in {listed(*FORMATS)}"
    )
    return made


def main(args: list[str] | None = None) -> int:
    """Run the program; see :func:`tf2_ros_cython.cli._program.run`."""
    return run(parser(), "tf2_ros.cli.tf2_plot:plot", args)
