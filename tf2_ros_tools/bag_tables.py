"""Which recording tf2_bag reads, and its tables of poses: lookup, in one recording, and batch, in many."""

from __future__ import annotations

import os
import sys
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tf2_ros_tools.output import printable
from tf2_ros_tools.program import (
    FAILURE,
    SUCCESS,
    Parser,
    RunError,
    UsageError,
    format_of,
    listed_endings,
    nanoseconds,
    positive_number,
    write_output,
)

if TYPE_CHECKING:
    from argparse import _MutuallyExclusiveGroup

    import numpy as np
    from numpy.typing import NDArray

    from tf2_ros_tools.loading import Heard, Topics
    from tf2_ros_tools.tables import Table


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
    :raises UsageError: ``--end`` is before ``--start``.
    :raises RunError: it cannot be read.
    :raises BagError: it is broken.
    """
    from tf2_ros_tools.loading import hear, wanted

    if None not in (options.start, options.end) and options.end < options.start:
        raise UsageError("--end must not be before --start")
    with reported_files(options.file):
        return hear(options.file, wanted(topics_of(options), options.start, options.end), at=at)


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


# Tables.


FORMATS = {
    "csv": "comma-separated values, the default; stamp_ns is in nanoseconds",
    "tum": "stamp x y z qx qy qz qw, the format of evo; stamp is in seconds",
    "npz": "NumPy arrays: stamps_ns, translations, rotations, valid",
    "parquet": "a Parquet table",
}
TEXTS = ("csv", "tum")


def add_lookup(made: Parser) -> None:
    """Add the arguments of lookup, besides the recording."""
    made.add_argument("target", metavar="TARGET", type=_frame, help="the frame in which the pose is given")
    made.add_argument("source", metavar="SOURCE", type=_frame, help="the frame whose pose is looked up")
    when = made.add_mutually_exclusive_group()
    when.add_argument(
        "--times",
        nargs="+",
        metavar="T",
        help="at these times, in seconds, or at those in the first column of a text file, which may be a CSV "
        "file of this program",
    )
    _add_when(when)
    kind = made.add_mutually_exclusive_group()
    for name, summary in FORMATS.items():
        kind.add_argument(f"--{name}", action="store_const", dest="format", const=name, help=summary)
    summary = f"write this file; without a format, its name ends in {listed_endings(*FORMATS)}"
    made.add_argument("-o", "--output", metavar="FILE", help=summary)


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
    how.add_argument("--workers", type=_count, metavar="N", help="processes; by default one per core")
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


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise ArgumentTypeError(f"expected a whole number above 0, got {text}")
    return int(text)


def lookup(options: Namespace) -> int:
    """Look up, and write a table; return the exit status."""
    from tf2_ros_tools import tables

    kind = _format_of(options)
    if options.output is None and kind not in TEXTS:
        raise UsageError(f"--{kind} needs a file: -o FILE")
    times_ns = None if options.times is None else _given_times(options.times)
    heard = heard_of(options, options.at)
    if options.at is not None:
        times_ns = heard.times_ns
    try:
        table = tables.look_up_when(heard, options.target, options.source, times_ns, options.rate)
    except ValueError as failure:
        raise RunError(str(failure)) from None
    if not table.valid.any():
        _refuse(heard, options, table)
    writers = {"csv": tables.as_csv, "tum": tables.as_tum, "npz": tables.as_npz}
    if kind == "parquet":
        contents = tables.as_parquet({"": table}, options.file)
    else:
        contents = writers[kind](table)
    if options.output is None:
        print(contents.decode(), end="")
    else:
        write_output(options.output, contents)
        print(options.output)
    missing = len(table) - int(table.valid.sum())
    if missing:
        left_out = ", which are left out" if kind == "tum" else ""
        print(
            f"{options.parser.prog}: no answer at {missing} of {len(table)} times{left_out}", file=sys.stderr
        )
    return SUCCESS


def batch(options: Namespace) -> int:
    """Make the tables of many recordings; return the exit status."""
    from tf2_ros_tools.fleet import map_recordings

    target, source = options.lookup
    several = len(options.recordings) > 1
    with reported_files(options.recordings[0]):
        try:
            result = map_recordings(
                options.recordings if several else options.recordings[0],
                target,
                source,
                options.out,
                at=options.at,
                rate=options.rate,
                topics=topics_of(options),
                workers=options.workers,
                scheduler=options.scheduler,
            )
        except ValueError as refusal:
            raise RunError(str(refusal)) from None
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


def _format_of(options: Namespace) -> str:
    if options.format is not None:
        return str(options.format)
    if options.output is None:
        return next(iter(FORMATS))
    ending = format_of(options.output)
    if ending not in FORMATS:
        formats = ", ".join(f"--{one}" for one in FORMATS)
        raise UsageError(
            f"-o {printable(options.output)} must end in {listed_endings(*FORMATS)}, or say {formats}"
        )
    return ending


def _refuse(heard: Heard, options: Namespace, table: Table) -> None:
    """Raise the reason why no time has an answer."""
    target, source = options.target, options.source
    time_ns = int(table.stamps_ns[0]) if len(table) else 0
    heard.buffer.lookup_transform_core(target, source, time_ns)  # raises, unless there is another reason
    if not len(table) and (options.at is not None or options.rate is not None):
        raise RunError("the recording has no time to look up")
    raise RunError(f"the frames between {target} and {source} were never all known at the same time")


def _given_times(texts: list[str]) -> NDArray[np.int64]:
    import numpy as np

    if len(texts) == 1 and os.path.exists(texts[0]):
        return np.array([*_times_in(texts[0])], np.int64)
    try:
        return np.array([*map(nanoseconds, texts)], np.int64)
    except ArgumentTypeError as refusal:
        raise UsageError(f"--times: {refusal}" + ", and not a file" * (len(texts) == 1)) from None


def _times_in(path: str) -> Iterator[int]:
    """Read the first words of the lines of a text file, which may be a CSV file of this program."""
    from tf2_ros_tools import tables

    read: Callable[[str], int] = nanoseconds
    try:
        with open(path, encoding="utf-8-sig") as file:
            for number, line in enumerate(file, 1):
                word = next(iter(line.replace(",", " ").split()), "#")
                try:
                    if number == 1 and word == tables.STAMP_NS:
                        read = int
                    elif not word.startswith("#"):
                        yield read(word)
                except (ArgumentTypeError, ValueError) as refusal:
                    raise UsageError(f"--times: {path}, line {number}: {refusal}") from None
    except OSError as failure:
        raise UsageError(f"--times: {path}: {failure.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"--times: {path} is not text") from None
