"""Owns what is done with one recording of many: its table, what is found, and whether it is done."""

import hashlib
import json
import os
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from tf2_py import TransformException
from tf2_py._internal import counted, printable
from tf2_ros._recordings.hearing import Heard, hear
from tf2_ros._recordings.loading import TOPICS
from tf2_ros._recordings.problems import BagError, needing
from tf2_ros._recordings.reading import MAGICS, open_recording, stamps_of
from tf2_ros._recordings.report import report
from tf2_ros._recordings.tables import Table, as_parquet, look_up_when
from tf2_ros._whole_files import write_whole

__all__ = ["Outcome", "Request", "Row", "done_before", "failed", "table_of", "work"]

S = 1_000_000_000
# Where a table says what it was made of. The number changes when that, or what a request means, does.
KEY, FORMAT = b"tf2_ros.map_recordings", 1
# What SQLite puts beside a database that is read.
COMPANIONS = ("-wal", "-shm", "-journal")


@dataclass(frozen=True)
class Request:
    """What is looked up in each recording; :func:`tf2_ros.bag.map_recordings` says what the fields mean."""

    target: str
    source: str
    at: str | None = None
    rate: float | None = None
    topics: Mapping[str, str] | None = None  # with prefixes; None: the usual ones
    partial: bool = False


@dataclass(frozen=True)
class Row:
    """One line of the table of findings. The numbers are those of the kind "summary"."""

    file: str
    kind: str
    frame: str
    text: str
    transforms: int | None = None
    rows: int | None = None
    valid: int | None = None
    span_s: float | None = None  # of the log times
    seconds: float | None = None  # that the recording took


@dataclass(frozen=True)
class Outcome:
    """What became of a recording."""

    recording: str
    found: tuple[Row, ...]
    problem: str | None = None  # why there is no table


def table_of(recording: str, out: str) -> str:
    """The path of a recording's table: it depends on the recording's own path alone."""
    name = os.path.basename(recording)
    stem, suffix = os.path.splitext(name)
    # Readers of folders leave out names with these first letters; 255 bytes is the longest name.
    short = os.fsencode(stem if suffix in MAGICS else name)[:150].decode(errors="ignore").lstrip("._")
    digest = hashlib.sha256(os.fsencode(recording)).hexdigest()[:12]
    return os.path.join(out, f"{short}-{digest}.parquet")


def work(request: Request, recording: str, table: str) -> Outcome:
    """
    Make the table of one recording; nobody sees half of it.

    What is wrong with the recording itself is part of the outcome. All else is raised: it may go well later,
    or on another machine.

    :param table: the path of the table; its folder exists.
    """
    begin = time.perf_counter()
    try:
        state = _state(recording)
        heard = hear(
            recording,
            topics=TOPICS if request.topics is None else request.topics,
            partial=request.partial,
            progress=False,
        )
        answers, found = _looked_up(request, recording, heard)
    except (BagError, FileNotFoundError) as error:
        return failed(recording, str(error))
    found += [_row(recording, one.kind, one.text, one.frame) for one in report(heard).findings]
    summary = _summary(recording, heard, answers)
    found.insert(0, replace(summary, seconds=round(time.perf_counter() - begin, 3)))
    content = {**_what(request, state), "found": [_without_none(one) for one in found]}
    write_whole(table, as_parquet(answers, printable(recording), {KEY: json.dumps(content).encode()}))
    return Outcome(recording, tuple(found))


def failed(recording: str, problem: str) -> Outcome:
    """The outcome of a recording without a table."""
    return Outcome(recording, (_row(recording, "error", problem),), problem)


def done_before(request: Request, recording: str, table: str) -> Outcome | None:
    """The outcome of an earlier run with the same request, if the recording is still what it was then."""
    with needing("pyarrow", "fleet"):
        from pyarrow import ArrowException, parquet
    try:
        with open(table, "rb") as file:
            content = json.loads((parquet.read_metadata(file).metadata or {})[KEY])
        if {name: content[name] for name in ("request", "recording")} != _what(request, _state(recording)):
            return None
        return Outcome(recording, tuple(Row(**one) for one in content["found"]))
    except (OSError, ArrowException, KeyError, TypeError, ValueError):
        return None  # no table, none of ours, or a spoiled one: it is made anew


def _what(request: Request, state: list[list[Any]]) -> dict[str, Any]:
    return {"request": {"format": FORMAT, **asdict(request)}, "recording": state}


def _state(recording: str) -> list[list[Any]]:
    """Names, sizes and times of its files: another state is another recording."""
    if not os.path.isdir(recording):
        return [_file(recording)]
    inside = [one.path for one in os.scandir(recording) if one.is_file()]
    return sorted(_file(path) for path in inside if not path.endswith(COMPANIONS))


def _file(path: str) -> list[Any]:
    try:
        status = os.stat(path)
    except FileNotFoundError:
        raise FileNotFoundError(f"there is no recording {printable(path)}") from None
    return [printable(os.path.basename(path)), status.st_size, status.st_mtime_ns]


def _looked_up(request: Request, recording: str, heard: Heard) -> tuple[Table, list[Row]]:
    found = [] if heard.problem is None else [_row(recording, "partial", heard.problem)]
    try:
        table = _table(request, recording, heard)
        if not table.valid.any():
            # Raises the reason, if there is one.
            heard.buffer.lookup_transform_core(request.target, request.source, 0)
    except TransformException as error:
        nothing = np.zeros(0, np.int64)
        table = Table(nothing, np.zeros((0, 3)), np.zeros((0, 4)), np.zeros(0, np.bool_))
        return table, [*found, _row(recording, "lookup", str(error))]
    missing = len(table) - int(table.valid.sum())
    if missing or not len(table):
        found.append(_row(recording, "lookup", f"no answer at {missing} of {counted(len(table), 'time')}"))
    return table, found


def _table(request: Request, recording: str, heard: Heard) -> Table:
    times_ns = None
    if request.at is not None:
        with open_recording(recording, partial=request.partial) as recorded:
            times_ns = stamps_of(recorded, request.at)
    return look_up_when(heard, request.target, request.source, times_ns, request.rate)


def _summary(recording: str, heard: Heard, table: Table) -> Row:
    rows, valid, transforms = len(table), int(table.valid.sum()), len(heard.records)
    span_s = 0.0
    if heard.start_ns is not None and heard.end_ns is not None:
        span_s = (heard.end_ns - heard.start_ns) / S
    text = (
        f"{counted(transforms, 'transform')} in {span_s:.1f} s, answers at {valid} of {counted(rows, 'time')}"
    )
    return Row(printable(recording), "summary", "", text, transforms, rows, valid, span_s)


def _row(recording: str, kind: str, text: str, frame: str = "") -> Row:
    return Row(printable(recording), kind, printable(frame), text)


def _without_none(row: Row) -> dict[str, Any]:
    return {name: value for name, value in asdict(row).items() if value is not None}
