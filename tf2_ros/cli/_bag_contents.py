"""Owns the commands of tf2_bag that tell what is in a recording, and what is wrong with it."""

import json
import os
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timezone
from typing import Any

from tf2_py._internal import counted, printable, three_digits
from tf2_ros._recordings.reading import Topic
from tf2_ros._recordings.report import LIMITS, Report, report
from tf2_ros._traffic.findings import Finding
from tf2_ros._traffic.streams import Stream
from tf2_ros.cli._bag_reading import heard_of, recorded_of
from tf2_ros.cli._figures import stream_line
from tf2_ros.cli._verdicts import (
    expected_by,
    line_of,
    not_ignored,
    refuse_unknown_kinds,
    verdict_of,
    write_junit,
)
from tf2_ros_cython.cli._program import FAILURE, SUCCESS

__all__ = ["check", "info"]

S = 1_000_000_000
SIZES = ("bytes", "kB", "MB", "GB", "TB")


@dataclass(frozen=True)
class Contents:
    """What the recording says of itself; times in seconds, None where it is empty."""

    file: str
    bytes: int
    begin: float | None
    end: float | None
    topics: list[Topic]


def info(options: Namespace) -> int:
    """Print what is in a recording; return the exit status."""
    with recorded_of(options) as recorded:
        contents = Contents(
            options.file,
            _size_of(options.file),
            None if recorded.start_ns is None else recorded.start_ns / S,
            None if recorded.end_ns is None else recorded.end_ns / S,
            sorted(recorded.topics.values(), key=lambda topic: topic.name),
        )
    if not options.json:
        # First: what cannot be read of the transforms ends this.
        for line in _as_text(contents):
            print(line)
    heard = heard_of(options)
    said = report(heard)
    if options.json:
        print(json.dumps({**asdict(contents), **asdict(said)}))
        return SUCCESS
    print("tree:")
    for line in heard.buffer.tree().splitlines():
        print(f"  {line}")
    print("frames:")
    for stream in said.streams:
        print(f"  {stream_line(stream)}{_gap(stream)}")
    if said.clocks_differ:
        print("stamps and log times are of different clocks: no delays")
    _print_findings(said, said.findings)
    return SUCCESS


def check(options: Namespace) -> int:
    """Print what is wrong with a recording; return the exit status."""
    expected = expected_by(options)
    refuse_unknown_kinds(options)
    said = report(heard_of(options), replace(LIMITS, min_rate=options.min_rate), expected)
    wrong = not_ignored(said.findings, options)
    if options.json:
        print(json.dumps({"file": options.file, **asdict(replace(said, findings=wrong))}))
    else:
        _print_findings(said, wrong)
    if options.junit is not None:
        write_junit(options.junit, "tf2_bag", wrong, options.ignore, _seconds(said))
    return FAILURE if wrong else SUCCESS


def _print_findings(said: Report, wrong: Sequence[Finding]) -> None:
    for finding in wrong:
        print(line_of(finding))
    what = f"{counted(said.transforms, 'transform')} and {three_digits(_seconds(said))} s"
    print(verdict_of(wrong, said.streams, what))


def _as_text(contents: Contents) -> Iterator[str]:
    yield f"{printable(contents.file)}: {_readable(contents.bytes)}"
    if contents.begin is not None and contents.end is not None:
        date = datetime.fromtimestamp(contents.begin, timezone.utc)
        span = f"{contents.begin:.3f} to {contents.end:.3f} s"
        yield f"{span} ({three_digits(contents.end - contents.begin)} s from {date:%Y-%m-%d %H:%M:%S} UTC)"
    yield "topics:"
    for topic in contents.topics:
        yield f"  {printable(topic.name)}: {printable(topic.msgtype)}, {counted(topic.count, 'message')}"


def _seconds(said: Report) -> float:
    return 0.0 if said.begin is None or said.end is None else said.end - said.begin


def _gap(stream: Stream) -> str:
    return "" if stream.static or stream.count < 2 else f", longest gap {three_digits(stream.gap)} s"


def _size_of(path: str) -> int:
    if not os.path.isdir(path):
        return os.path.getsize(path)
    return sum(entry.stat().st_size for entry in os.scandir(path) if entry.is_file())


def _readable(size: int) -> str:
    value: Any = size
    for unit in SIZES[:-1]:
        if value < 1000:
            return f"{value:.3g} {unit}"
        value /= 1000
    return f"{value:.3g} {SIZES[-1]}"
