"""Add the options that select a recording for tf2_bag, and read the recording."""

from __future__ import annotations

from argparse import ArgumentTypeError, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from tf2_ros_tools.output import printable
from tf2_ros_tools.program import Parser, RunError, UsageError, nanoseconds

if TYPE_CHECKING:
    from tf2_ros_tools.loading import Heard, Topics


def add_recording(made: Parser) -> None:
    """Add the arguments for the recording, and for which of its transforms are read."""
    made.add_argument("file", metavar="FILE", help="the recording")
    add_topics(made)
    made.add_argument(
        "--start",
        type=nanoseconds,
        metavar="S",
        help="omit dynamic transforms that were recorded before this time",
    )
    made.add_argument(
        "--end", type=nanoseconds, metavar="S", help="or after this time; both are log times, in seconds"
    )


def add_topics(made: Parser) -> None:
    """Add the option for the topics to read."""
    made.add_argument(
        "--topic",
        action="append",
        type=_topic,
        metavar="NAME[=PREFIX]",
        dest="topics",
        help="read the transforms of this topic, and put PREFIX in front of its frame names; may be given "
        "several times; by default, /tf and /tf_static are read",
    )


def _topic(text: str) -> tuple[str, str]:
    name, _, prefix = text.partition("=")
    if not name:
        raise ArgumentTypeError(f"must begin with the name of a topic, not {text!r}")
    return name, prefix


NS_BITS = 63
WANTED_TIMES = "must be seconds since 1970, and before the year 2262"  # what fits into 64 bits of nanoseconds


def topics_of(options: Namespace) -> Topics:
    """Get the topics to read."""
    from tf2_ros_tools.loading import TOPICS

    return TOPICS if options.topics is None else dict(options.topics)


def heard_of(options: Namespace, at: str | None = None) -> Heard:
    """
    Read the transforms of the recording.

    :param at: a topic whose stamps are read, too.
    :raises UsageError: ``--end`` is before ``--start``, or one of them does not fit into 64 bits.
    :raises RunError: it cannot be read.
    :raises BagError: it is broken.
    """
    from tf2_ros_tools.loading import hear, wanted

    for name, time_ns in (("--start", options.start), ("--end", options.end)):
        if time_ns is not None and abs(time_ns) >> NS_BITS:
            raise UsageError(f"{name} {WANTED_TIMES}")
    if None not in (options.start, options.end) and options.end < options.start:
        raise UsageError("--end must not be before --start")
    with reported_files(options.file):
        what = wanted(topics_of(options), options.start, options.end)
        heard = hear(options.file, what, at=at)
    if heard.end_ns is not None and options.end is not None:
        # What was recorded later is not missing.
        heard = replace(heard, end_ns=min(heard.end_ns, options.end))
    return heard


@contextmanager
def reported_files(path: str) -> Iterator[None]:
    """
    Raise a RunError for a file that cannot be read or written.

    :param path: of the file, for errors that do not name one.
    """
    try:
        yield
    except OSError as failure:
        # Errors of this project have a text instead of a number.
        text = f"{failure.filename or path}: {failure.strerror}" if failure.strerror else str(failure)
        raise RunError(printable(text)) from None
