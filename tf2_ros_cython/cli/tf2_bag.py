# PYTHON_ARGCOMPLETE_OK
"""Owns the command line of the program for recorded transforms."""

from __future__ import annotations

from argparse import ArgumentTypeError
from typing import TYPE_CHECKING

from tf2_ros_cython.cli._checks import add_check_options
from tf2_ros_cython.cli._endings import ending_in, listed
from tf2_ros_cython.cli._numbers import nanoseconds, positive_number
from tf2_ros_cython.cli._plots import add_plot_options
from tf2_ros_cython.cli._program import Parser, run

if TYPE_CHECKING:
    from argparse import _MutuallyExclusiveGroup

__all__ = ["TABLES", "main"]

PLOTS = ("png", "svg")
TREES = ("pdf", "svg", "png", "gv")
TABLES = ("csv", "tum", "npz", "parquet")

DESCRIPTION = """\
Answer questions about recorded transforms, without ROS: what is in a recording, what is wrong with it, and \
where a frame was at which time.

A recording is a folder of rosbag2, or a file that ends in .mcap, .db3 or .bag (ROS 1). Each command has a \
help of its own, such as tf2_bag lookup --help."""

EXAMPLE = """\
  tf2_bag info drive.mcap
  tf2_bag lookup drive.mcap map base_link -o way.tum
  tf2_bag check drive.mcap --expect robot.yaml --junit transforms.xml
  tf2_bag batch recordings/ --lookup map base_link --rate 10 --out tables"""

INFO = """\
Print what is in a recording: its topics, the tree of frames, how often and how late each frame was \
received, and what is wrong, as tf2_bag check finds it.

Exit status: 0 if it can be read, otherwise 1."""

CHECK = """\
Print what is wrong with the transforms of a recording, one line each: unconnected trees, loops, frames with \
two parents or of two topics, frames that end early, gaps, stamps in the future, and what differs from a \
file of expectations.

Exit status: 0 if nothing is wrong, otherwise 1."""

LOOKUP = """\
Look up the pose of the frame SOURCE in the frame TARGET at many times, and write one line for each. By \
default, the times are the stamps of all dynamic transforms between both.

Exit status: 0 if a time had an answer, otherwise 1."""

TREE = """\
Print the tree of frames, or draw it with topics, rates and delays, as view_frames does.

Exit status: 0 if that was possible, otherwise 1."""

PLOT = """\
Draw when each frame was received, with gaps, rates and delays, as tf2_plot does. With --path: the way of a \
frame in another one, from above, and its components over time. The name of the file is printed.

Exit status: 0 if the picture was written, otherwise 1."""

BATCH = """\
Look up the pose of one frame in another one in many recordings: a table (Parquet) for each of them, and one \
table of what is wrong in them. What an earlier run has finished is not done again.

Exit status: 0 if all recordings could be read, otherwise 1."""

VIEW = """\
Open a recording in the viewer rerun: its frames, and how they move.

Exit status: 0 if it was opened or written, otherwise 1."""


def parser() -> Parser:
    """Its command line."""
    made = Parser("tf2_bag", DESCRIPTION, EXAMPLE, node=False)
    _add_info(made)
    _add_check(made)
    _add_lookup(made)
    _add_tree(made)
    _add_plot(made)
    _add_batch(made)
    _add_view(made)
    return made


def main(args: list[str] | None = None) -> int:
    """Run the program; see :func:`tf2_ros_cython.cli._program.run`."""
    return run(parser(), "tf2_ros.cli.tf2_bag:bag", args)


def _add_info(program: Parser) -> None:
    made = program.add_command(
        "info", "what is in a recording", INFO, "  tf2_bag info drive.mcap\n  tf2_bag info drive.mcap --json"
    )
    _add_recording(made)
    made.add_argument("--json", action="store_true", help="print one JSON object")


def _add_check(program: Parser) -> None:
    made = program.add_command(
        "check",
        "whether its transforms are as they must be",
        CHECK,
        "  tf2_bag check drive.mcap --expect robot.yaml --junit transforms.xml\n"
        "  tf2_bag check drive.mcap --min-rate 10 --ignore stale",
    )
    _add_recording(made)
    made.add_argument("--json", action="store_true", help="print one JSON object")
    add_check_options(made)


def _add_lookup(program: Parser) -> None:
    made = program.add_command(
        "lookup",
        "where a frame was, as a table",
        LOOKUP,
        "  tf2_bag lookup drive.mcap map base_link > way.csv\n"
        "  tf2_bag lookup drive.mcap map lidar --at /points -o lidar.tum\n"
        "  tf2_bag lookup drive.mcap map base_link --rate 10 -o way.parquet\n"
        "  tf2_bag lookup drive.mcap map base_link --times 1795210034.5 1795210035",
    )
    _add_recording(made)
    made.add_argument("target", metavar="TARGET", help="the frame in which it is seen")
    made.add_argument("source", metavar="SOURCE", help="the frame whose pose is wanted")
    when = made.add_mutually_exclusive_group()
    when.add_argument(
        "--times",
        nargs="+",
        metavar="T",
        help="at these times, in seconds; or a file with one in the first column of each line",
    )
    _add_when(when)
    kind = made.add_mutually_exclusive_group()
    for name, summary in (
        ("csv", "comma-separated values, the default; stamp_ns is in nanoseconds"),
        ("tum", "stamp x y z qx qy qz qw, as evo reads them; stamp is in seconds"),
        ("npz", "arrays of NumPy: stamps_ns, translations, rotations, valid"),
        ("parquet", "a table of Parquet"),
    ):
        kind.add_argument(f"--{name}", action="store_const", dest="format", const=name, help=summary)
    made.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        help=f"write this file; its end says the format where it is {listed(*TABLES)}",
    )


def _add_tree(program: Parser) -> None:
    made = program.add_command(
        "tree",
        "its tree of frames, as text or as a picture",
        TREE,
        "  tf2_bag tree drive.mcap\n  tf2_bag tree drive.mcap -o tree.svg",
    )
    _add_recording(made)
    made.add_argument(
        "-o", "--output", metavar="FILE", type=ending_in(*TREES), help=f"ends in {listed(*TREES)}"
    )


def _add_plot(program: Parser) -> None:
    made = program.add_command(
        "plot",
        "its frames over time, or a way, as a picture",
        PLOT,
        "  tf2_bag plot drive.mcap\n  tf2_bag plot drive.mcap odom base_link -o odometry.svg\n"
        "  tf2_bag plot drive.mcap --path map base_link -o way.svg",
    )
    _add_recording(made)
    add_plot_options(made)
    made.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=ending_in(*PLOTS),
        help=f"ends in {listed(*PLOTS)}; by default the recording's name with .png, in the current folder",
    )


def _add_batch(program: Parser) -> None:
    made = program.add_command(
        "batch",
        "lookup and check of many recordings",
        BATCH,
        "  tf2_bag batch recordings/ --lookup map base_link --rate 10 --out tables\n"
        "  tf2_bag batch 'day1/*.mcap' --lookup map lidar --at /points --out tables --workers 4",
    )
    made.add_argument(
        "recordings",
        metavar="RECORDINGS",
        help="a folder that has some, a pattern such as 'day1/*.mcap', or a text file with one path a line",
    )
    made.add_argument(
        "--lookup", nargs=2, metavar=("TARGET", "SOURCE"), required=True, help="the pose of SOURCE in TARGET"
    )
    _add_when(made.add_mutually_exclusive_group())
    made.add_argument("--out", metavar="DIR", required=True, help="where the tables are written")
    how = made.add_mutually_exclusive_group()
    how.add_argument("--workers", type=_count, metavar="N", help="processes; by default one for each core")
    how.add_argument("--scheduler", metavar="ADDRESS", help="of a cluster of Dask's that does the work")
    _add_topics(made)


def _add_view(program: Parser) -> None:
    made = program.add_command(
        "view",
        "open it in rerun",
        VIEW,
        "  tf2_bag view drive.mcap\n  tf2_bag view drive.mcap -o drive.rrd",
    )
    _add_recording(made)
    made.add_argument(
        "-o", "--output", metavar="FILE", type=ending_in("rrd"), help="write this .rrd, and open nothing"
    )


def _add_recording(made: Parser) -> None:
    made.add_argument("file", metavar="FILE", help="the recording")
    _add_topics(made)
    made.add_argument(
        "--start",
        type=nanoseconds,
        metavar="S",
        help="without dynamic transforms that were recorded before this time",
    )
    made.add_argument(
        "--end", type=nanoseconds, metavar="S", help="or after this one; both are log times, in seconds"
    )


def _add_topics(made: Parser) -> None:
    made.add_argument(
        "--topic",
        action="append",
        type=_topic,
        metavar="NAME[=PREFIX]",
        dest="topics",
        help="of transforms, with what their frames' names get in front; may be given several times; "
        "/tf and /tf_static by default",
    )
    made.add_argument(
        "--partial", action="store_true", help="of a broken recording, take what can be read before the break"
    )


def _add_when(group: _MutuallyExclusiveGroup) -> None:
    group.add_argument("--at", metavar="TOPIC", help="at the stamps of the messages of another topic")
    group.add_argument(
        "--rate", type=positive_number, metavar="HZ", help="so often, while all frames between both have data"
    )


def _topic(text: str) -> tuple[str, str]:
    name, _, prefix = text.partition("=")
    if not name:
        raise ArgumentTypeError(f"must begin with the name of a topic, not {text!r}")
    return name, prefix


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise ArgumentTypeError(f"must be a whole number above 0, not {text}")
    return int(text)
