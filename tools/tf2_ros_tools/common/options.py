# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Provide the types of arguments, and the options, that several programs have."""

import math
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Iterable
from decimal import Decimal
from os.path import splitext
from typing import TypeVar

from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.common.program import Parser, UsageError

_Value = TypeVar("_Value")

# Numbers on a command line.


def _number(expected: str, accepts: Callable[[float], bool]) -> Callable[[str], float]:
    """For argparse: read a number as Python's ``float`` does, and refuse the others in words."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise ArgumentTypeError(f"{text!r} is not a number") from None
        if not (math.isfinite(value) and accepts(value)):
            raise ArgumentTypeError(f"expected {expected}, got {text}")
        return value

    return read


finite_number = _number("a finite number", lambda value: True)
positive_number = _number("a number above 0", lambda value: value > 0.0)
non_negative_number = _number("0 or more", lambda value: value >= 0.0)
# The stamp of a message has 31 bits for seconds since 1970.
_stamp = _number("seconds since 1970, before January 19, 2038", lambda value: 0.0 <= value < 2**31)


def nanoseconds(text: str) -> int:
    """Read seconds and return nanoseconds, exactly; a float cannot hold all digits of a stamp."""
    _stamp(text)
    return round(Decimal(text.strip()) * 10**9)


# Formats of files, which follow from the extensions of their names.


def format_of(name: str) -> str:
    """The format that the extension of a file's name means."""
    return splitext(name)[1][1:].lower()


def ending_in(*formats: str) -> Callable[[str], str]:
    """For argparse: accept the names of files with one of these extensions, which are given without a dot."""

    def checked(name: str) -> str:
        if format_of(name) not in formats:
            raise ArgumentTypeError(f"expected a name that ends in {_listed_endings(*formats)}, got {name!r}")
        return name

    return checked


def _listed_endings(*formats: str) -> str:
    """List extensions in a text."""
    *others, last = (f".{one}" for one in formats)
    return f"{', '.join(others)} or {last}" if others else last


# Options that several programs have.


def add_live_option(parser: Parser) -> None:
    """Add ``--live`` to a program that listens, as its last option; see ``session_choice.session``."""
    parser.add_argument(
        "--live",
        metavar="WHERE",
        help="listen to the robot at dds://, zenoh://HOST:7447 or ws://HOST:8765, without ROS 2 on this "
        f"machine; not with {parser.listed_of_ros()}",
    )


def add_topic_option(
    made: ArgumentParser, what: str = "read transforms from this topic instead of /tf and /tf_static"
) -> None:
    """
    Add ``topics`` of a recording: None, or a list of pairs of a topic and a prefix.

    :param what: the begin of its help.
    """
    made.add_argument(
        "--topic",
        action="append",
        type=_topic,
        metavar="NAME[=PREFIX]",
        dest="topics",
        help=f"{what}, and put PREFIX in front of its frame names; may be given several times",
    )


def _topic(text: str) -> tuple[str, str]:
    name, _, prefix = text.partition("=")
    if not name:
        raise ArgumentTypeError(f"expected NAME or NAME=PREFIX, got {text!r}")
    return name, prefix


def by_topic(option: str, given: Iterable[tuple[str, _Value]]) -> dict[str, _Value]:
    """
    Get the values of an option that may be given several times, by their topics.

    :raises UsageError: a topic is given twice; only one of its values would count.
    """
    found: dict[str, _Value] = {}
    for topic, value in given:
        if topic in found:
            raise UsageError(f"{option}: expected each topic once, got {topic} twice")
        found[topic] = value
    return found


def add_plot_options(made: ArgumentParser, default: str) -> None:
    """
    Add what is plotted, some frames or a path, and the file.

    :param default: the name of the file without ``-o``, for the help.
    """
    made.add_argument(
        "frames",
        nargs="*",
        metavar="FRAME",
        default=[],
        help="plot only these frames, in this order",
    )
    made.add_argument(
        "--path",
        nargs=2,
        metavar=("TARGET", "SOURCE"),
        help="plot the path of the frame SOURCE in the frame TARGET",
    )
    add_output(made, "png", "svg", "pdf", more=f"; by default {default}")


def refuse_plot(options: Namespace) -> None:
    """Raise a UsageError for frames together with a path, and an error if matplotlib is not installed."""
    if options.path is not None and options.frames:
        raise UsageError("expected frames or --path, got both")
    require("matplotlib", "plot")


def add_output(made: ArgumentParser, *formats: str, more: str = "") -> None:
    """Add the file that is written; ``more`` is the end of its help."""
    summary = f"write this {_listed_endings(*formats)} file{more}"
    made.add_argument("-o", "--output", metavar="FILE", type=ending_in(*formats), help=summary)
