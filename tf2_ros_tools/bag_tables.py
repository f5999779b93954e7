"""Which recording tf2_bag reads, and its tables of poses: lookup, in one recording, and batch, in many."""

from __future__ import annotations

import sys
from argparse import ArgumentTypeError, Namespace
from typing import TYPE_CHECKING

from tf2_ros_tools.output import printable
from tf2_ros_tools.program import (
    FAILURE,
    SUCCESS,
    Parser,
    RunError,
    add_output,
    format_of,
    nanoseconds,
    positive_number,
    write_output,
)

if TYPE_CHECKING:
    from argparse import _MutuallyExclusiveGroup

    from tf2_ros_tools.loading import Heard, Topics


def add_recording(made: Parser) -> None:
    """Add the arguments for the recording, and for which of its transforms are read."""
    made.add_argument("file", metavar="FILE", help="the recording")
    add_topics(made)
    for name, summary in (
        ("--start", "omit dynamic transforms that were recorded before this time"),
        ("--end", "or after this time; both are log times, in seconds"),
    ):
        made.add_argument(name, type=nanoseconds, metavar="S", help=summary)


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


def topics_of(options: Namespace) -> Topics:
    """Get the topics to read."""
    from tf2_ros_tools.loading import TOPICS

    return TOPICS if options.topics is None else dict(options.topics)


def heard_of(options: Namespace, at: str | None = None) -> Heard:
    """
    Read the transforms of the recording.

    :param at: a topic whose stamps are read, too.
    """
    from tf2_ros_tools.loading import hear, wanted

    return hear(options.file, wanted(topics_of(options), options.start, options.end), at=at)


# Tables.


def add_lookup(made: Parser) -> None:
    """Add the arguments of lookup, besides the recording."""
    made.add_argument("target", metavar="TARGET", type=_frame, help="the frame in which the pose is given")
    made.add_argument("source", metavar="SOURCE", type=_frame, help="the frame whose pose is looked up")
    when = made.add_mutually_exclusive_group()
    when.add_argument("--times", nargs="+", type=nanoseconds, metavar="T", help="at these times, in seconds")
    _add_when(when)
    add_output(made, "csv", "tum", "parquet", more=", instead of printing CSV")


def add_batch(made: Parser) -> None:
    """Add the arguments of batch."""
    made.add_argument(
        "recordings",
        nargs="+",
        metavar="RECORDING",
        help="a recording, or a folder that is searched for them",
    )
    ends = ("TARGET", "SOURCE")
    summary = "the pose of SOURCE in TARGET"
    made.add_argument("--lookup", nargs=2, metavar=ends, type=_frame, required=True, help=summary)
    _add_when(made.add_mutually_exclusive_group())
    made.add_argument("--out", metavar="DIR", required=True, help="where the tables are written")
    how = made.add_mutually_exclusive_group()
    how.add_argument("--workers", type=int, metavar="N", help="processes; by default one per core")
    how.add_argument(
        "--scheduler", metavar="ADDRESS", help="the scheduler of a Dask cluster that does the work"
    )
    add_topics(made)


def _add_when(group: _MutuallyExclusiveGroup) -> None:
    group.add_argument("--at", metavar="TOPIC", help="at the stamps of the messages of another topic")
    summary = "at this rate, while all frames on the path have data"
    group.add_argument("--rate", type=positive_number, metavar="HZ", help=summary)


def _frame(name: str) -> str:
    return name.removeprefix("/")


def lookup(options: Namespace) -> int:
    """Look up, and write a table; return the exit status."""
    from tf2_ros_tools import tables

    heard = heard_of(options, options.at)
    target, source = options.target, options.source
    times_ns = options.times if options.at is None else heard.times_ns
    if times_ns is None:
        times_ns = tables.times_when(heard, target, source, options.rate)
    table = tables.look_up_table(heard.buffer, target, source, times_ns)
    if not table.valid.any():
        raise RunError(tables.why_unanswered(heard.buffer, target, source, table.stamps_ns))
    if options.output is None:
        print(tables.as_csv(table).decode(), end="")
    else:
        write_output(options.output, tables.contents_of(table, format_of(options.output), options.file))
        print(options.output)
    missing = len(table) - int(table.valid.sum())
    if missing:
        left_out = ", which are left out" if options.output and format_of(options.output) == "tum" else ""
        print(
            f"{options.parser.prog}: no answer at {missing} of {len(table)} times{left_out}", file=sys.stderr
        )
    return SUCCESS


def batch(options: Namespace) -> int:
    """Make the tables of many recordings; return the exit status."""
    from tf2_ros_tools.fleet import map_recordings

    target, source = options.lookup
    recordings = options.recordings if len(options.recordings) > 1 else options.recordings[0]
    try:
        result = map_recordings(
            recordings,
            target,
            source,
            options.out,
            at=options.at,
            rate=options.rate,
            topics=topics_of(options),
            workers=options.workers,
            scheduler=options.scheduler,
        )
    except KeyboardInterrupt:
        print(f"{options.parser.prog}: interrupted; the same command does the rest", file=sys.stderr)
        raise
    for problem in result.failed.values():
        print(f"{options.parser.prog}: {problem}", file=sys.stderr)
    for recording, reason in result.unanswered.items():
        print(f"{options.parser.prog}: {printable(recording)}: {reason}", file=sys.stderr)
    lack = f", {len(result.unanswered)} without an answer" if result.unanswered else ""
    print(f"{len(result.done)} done, {len(result.skipped)} done before, {len(result.failed)} failed{lack}")
    print(result.findings)
    return FAILURE if result.failed or result.unanswered else SUCCESS
