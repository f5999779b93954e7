# PYTHON_ARGCOMPLETE_OK
"""Owns the command line of the program that prints a transform again and again."""

from argparse import ArgumentTypeError

from tf2_ros_cython.cli._numbers import nanoseconds, non_negative_number, positive_number
from tf2_ros_cython.cli._program import Parser, run

__all__ = ["STAMPS_END_NS", "main"]

STAMPS_END_NS = 2**31 * 10**9  # a stamp has 31 bits for its seconds

MOST_DIGITS = 17  # more than a double has

DESCRIPTION = """\
Print the transform that maps data from the frame SOURCE to the frame TARGET, RATE times a second. \
While there is none, log why, and the frames that are known.

With --json, each line is {"header": {"stamp": {"sec", "nanosec"}, "frame_id"}, "child_frame_id", \
"transform": {"translation": {"x", "y", "z"}, "rotation": {"x", "y", "z", "w"}}, "rpy": {"roll", "pitch", \
"yaw"}}, the last in radians; for a failed lookup, "error": {"type", "text"} instead of transform and rpy.

Exit status: 0 if a transform was printed, 1 if none was available within --wait, 2 for wrong usage, \
130 if Ctrl-C came before the first transform."""

EXAMPLE = """\
  tf2_echo map base_link 10                  ten times a second
  tf2_echo map base_link --once --wait 5     for scripts: the status tells whether there is one
  tf2_echo map base_link --offset -0.5       as of half a second ago
  tf2_echo map base_link --json --once       one line, for programs to read"""


def parser() -> Parser:
    """Its command line."""
    made = Parser("tf2_echo", DESCRIPTION, EXAMPLE)
    made.add_argument("target", metavar="TARGET", help="the frame that data is transformed to")
    made.add_argument("source", metavar="SOURCE", help="the frame that data is in")
    made.add_argument(
        "rate",
        metavar="RATE",
        nargs="?",
        type=positive_number,
        default=1.0,
        help="prints per second, default 1",
    )
    made.add_argument("--once", action="store_true", help="end after the first transform")
    made.add_argument(
        "--wait",
        metavar="SECONDS",
        type=non_negative_number,
        help="end with status 1 if there is no transform after so long; default: wait for ever",
    )
    when = made.add_mutually_exclusive_group()
    when.add_argument(
        "--time",
        dest="time_ns",
        metavar="SECONDS",
        type=_stamp,
        default=0,
        help="look up at this time since the epoch; default 0, the latest",
    )
    when.add_argument(
        "--offset",
        dest="offset_ns",
        metavar="SECONDS",
        type=_offset,
        help="look up at the time that is so far from now; negative is the past",
    )
    made.add_argument(
        "--json", action="store_true", help='print one JSON object per line; a failed lookup has an "error"'
    )
    made.add_argument(
        "--precision",
        metavar="DIGITS",
        type=_digits,
        help="digits after the point; default 3, with --json all",
    )
    return made


def main(args: list[str] | None = None) -> int:
    """Run the program; see :func:`tf2_ros_cython.cli._program.run`."""
    return run(parser(), "tf2_ros.cli.tf2_echo:echo", args)


def _stamp(text: str) -> int:
    stamp_ns = nanoseconds(text)
    if not 0 <= stamp_ns < STAMPS_END_NS:
        raise ArgumentTypeError(f"must be from 0 to 2**31 - 1, as the seconds of a stamp, not {text}")
    return stamp_ns


def _offset(text: str) -> int:
    offset_ns = nanoseconds(text)
    if abs(offset_ns) >= STAMPS_END_NS:
        raise ArgumentTypeError(f"must be between -2**31 and 2**31, not {text}")
    return offset_ns


def _digits(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) <= MOST_DIGITS):
        raise ArgumentTypeError(f"must be a whole number from 0 to {MOST_DIGITS}, not {text}")
    return int(text)
