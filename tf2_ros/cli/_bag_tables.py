"""Owns the commands of tf2_bag that make tables: of one recording, and of many."""

import sys
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Mapping
from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from tf2_ros._recordings.hearing import Heard
from tf2_ros._recordings.reading import stamps_of
from tf2_ros._recordings.tables import (
    Table,
    as_csv,
    as_npz,
    as_parquet,
    as_tum,
    look_up_when,
)
from tf2_ros.cli._bag_reading import heard_of, recorded_of, telling_files, topics_of
from tf2_ros.cli._files import write_whole
from tf2_ros_cython.cli._endings import format_of
from tf2_ros_cython.cli._numbers import nanoseconds
from tf2_ros_cython.cli._program import FAILURE, SUCCESS, RunError, UsageError, raise_if_signalled
from tf2_ros_cython.cli.tf2_bag import TABLES

__all__ = ["batch", "lookup"]

# From a table and the recording's name.
CONTENTS: Mapping[str, Callable[[Table, str], bytes]] = {
    "csv": lambda table, _: as_csv(table),
    "tum": lambda table, _: as_tum(table),
    "npz": lambda table, _: as_npz(table),
    "parquet": as_parquet,
}
assert tuple(CONTENTS) == TABLES
TEXTS = ("csv", "tum")


def lookup(options: Namespace) -> int:
    """Look up, and write a table; return the exit status."""
    kind = _format_of(options)
    if options.output is None and kind not in TEXTS:
        raise UsageError(f"--{kind} needs a file: -o FILE")
    times_ns = None if options.times is None else _given_times(options.times)
    heard = heard_of(options)
    try:
        table = _table(options, heard, times_ns)
    except ValueError as failure:
        raise RunError(str(failure)) from None
    if not table.valid.any():
        _refuse(heard, options, table)
    contents = CONTENTS[kind](table, options.file)
    if options.output is None:
        # Line by line: a stream without a buffer drops the rest of a long text that it can write in part.
        for line in BytesIO(contents):
            print(line.decode(), end="")
    else:
        write_whole(options.output, contents)
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
    from tf2_ros._recordings.fleet import map_recordings

    target, source = (name.removeprefix("/") for name in options.lookup)
    with telling_files(options.recordings):
        try:
            result = map_recordings(
                options.recordings,
                target,
                source,
                options.out,
                at=options.at,
                rate=options.rate,
                topics=topics_of(options),
                partial=options.partial,
                workers=options.workers,
                scheduler=options.scheduler,
            )
            raise_if_signalled()
        except ValueError as refusal:
            raise RunError(str(refusal)) from None
        except KeyboardInterrupt:
            print(f"{options.parser.prog}: interrupted; the same command does the rest", file=sys.stderr)
            raise
    for problem in result.failed.values():
        print(f"{options.parser.prog}: {problem}", file=sys.stderr)
    print(f"{len(result.done)} done, {len(result.skipped)} done before, {len(result.failed)} failed")
    print(result.findings)
    return FAILURE if result.failed else SUCCESS


def _format_of(options: Namespace) -> str:
    if options.format is not None:
        return str(options.format)
    ending = "" if options.output is None else format_of(options.output)
    return ending if ending in TABLES else TABLES[0]


def _table(options: Namespace, heard: Heard, times_ns: NDArray[np.int64] | None) -> Table:
    target, source = _frames(options)
    if options.at is not None:
        with recorded_of(options) as recorded:
            times_ns = stamps_of(recorded, options.at)
    return look_up_when(heard, target, source, times_ns, options.rate)


def _frames(options: Namespace) -> tuple[str, str]:
    return options.target.removeprefix("/"), options.source.removeprefix("/")


def _refuse(heard: Heard, options: Namespace, table: Table) -> None:
    """Raise why there is no answer at all."""
    target, source = _frames(options)
    time_ns = int(table.stamps_ns[0]) if len(table) else 0
    heard.buffer.lookup_transform_core(target, source, time_ns)  # raises, unless there is another reason
    if not len(table) and (options.at is not None or options.rate is not None):
        raise RunError("there is no time to look up at")
    raise RunError(f"at no time all frames between {target} and {source} were known")


def _given_times(texts: list[str]) -> NDArray[np.int64]:
    try:
        return np.array([nanoseconds(text) for text in texts], np.int64)
    except ArgumentTypeError as refusal:
        if len(texts) > 1:
            raise UsageError(f"--times: {refusal}") from None
    except OverflowError:
        raise UsageError("--times: in nanoseconds, they must fit into 64 bits") from None
    return _times_in(texts[0])


def _times_in(path: str) -> NDArray[np.int64]:
    try:
        with open(path, encoding="utf-8") as file:
            lines = [(number, line.replace(",", " ").split()) for number, line in enumerate(file, 1)]
    except OSError as failure:
        raise UsageError(f"--times: {path}: {failure.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"--times: {path} is no text") from None
    times = []
    for number, words in lines:
        if words and not words[0].startswith("#"):
            try:
                times.append(nanoseconds(words[0]))
            except ArgumentTypeError as refusal:
                raise UsageError(f"--times: {path}, line {number}: {refusal}") from None
    try:
        return np.array(times, np.int64)
    except OverflowError:
        raise UsageError(f"--times: {path}: in nanoseconds, they must fit into 64 bits") from None
