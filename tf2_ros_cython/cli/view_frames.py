# PYTHON_ARGCOMPLETE_OK
"""Owns the command line of the program that draws the tree of frames."""

from argparse import Namespace
from os.path import splitext

from tf2_ros_cython.cli._endings import format_of
from tf2_ros_cython.cli._numbers import non_negative_number
from tf2_ros_cython.cli._program import Parser, run

__all__ = ["main", "output_files"]

FORMATS = ("pdf", "svg", "png")
WAIT_S = 5.0
WATCH_S = 1.0

DESCRIPTION = """\
Listen to transforms for a while, and draw the tree of frames with publishers, rates and delays: as NAME.gv, \
for Graphviz, and as NAME.pdf. The names of the files are printed.

Exit status: 0 if the files were written, otherwise 1."""

EXAMPLE = """\
  view_frames                     frames_DATE.gv and frames_DATE.pdf
  view_frames -t 10 -o robot.svg  robot.gv and robot.svg, after ten seconds
  view_frames --watch             frames.svg is renewed every second
  view_frames --text              the tree in the terminal"""


def parser() -> Parser:
    """Its command line."""
    made = Parser("view_frames", DESCRIPTION, EXAMPLE)
    made.add_argument(
        "-t",
        "--wait-time",
        type=non_negative_number,
        metavar="S",
        help=f"listen for S seconds, {WAIT_S:g} by default; with --watch before each picture, {WATCH_S:g}",
    )
    made.add_argument(
        "-o",
        "--output",
        metavar="NAME",
        help="write NAME.gv and NAME.pdf; where NAME ends in .pdf, .svg or .png, that picture",
    )
    how = made.add_mutually_exclusive_group()
    how.add_argument(
        "--watch", action="store_true", help="renew the picture, an .svg by default, until interrupted"
    )
    how.add_argument("--text", action="store_true", help="print the tree; write files only if -o names them")
    made.add_argument("--tf_topic", metavar="TOPIC", default="/tf", help="of dynamic transforms")
    made.add_argument("--tf_static_topic", metavar="TOPIC", default="/tf_static", help="of static transforms")
    return made


def output_files(options: Namespace, date: str) -> tuple[str, str, str]:
    """
    The file for Graphviz, the picture, and the format of that.

    :param date: for the names of files that the options do not name.
    """
    name = options.output
    if name is None:
        name = "frames" if options.watch else f"frames_{date}"
    if format_of(name) in FORMATS:
        return f"{splitext(name)[0]}.gv", name, format_of(name)
    kind = "svg" if options.watch else "pdf"
    return f"{name}.gv", f"{name}.{kind}", kind


def main(args: list[str] | None = None) -> int:
    """Run the program; see :func:`tf2_ros_cython.cli._program.run`."""
    return run(parser(), "tf2_ros.cli.view_frames:view", args)
