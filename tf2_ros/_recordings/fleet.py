"""Owns ``map_recordings``: what is done of many recordings, what is left, and what came of it."""

import os
from collections.abc import Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING

from tf2_py import BufferCore, LookupException
from tf2_ros._recordings.findings_file import write_findings
from tf2_ros._recordings.loading import TOPICS, Topics, wanted
from tf2_ros._recordings.mapping import Outcome, Request, done_before, table_of
from tf2_ros._recordings.progress import progress_bar
from tf2_ros._recordings.searching import Recordings, find_recordings
from tf2_ros._recordings.tables import check_rate
from tf2_ros._recordings.workers import outcomes
from tf2_ros._whole_files import remove_abandoned

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["MappedRecordings", "map_recordings"]


@dataclass(frozen=True, repr=False)
class MappedRecordings:
    """
    What became of many recordings. All paths are absolute.

    :param done: the tables made by this run, by the paths of the recordings.
    :param skipped: likewise, those that an earlier run had made.
    :param failed: what is wrong with the others, by their paths.
    :param out: the folder with the tables.
    :param findings: the table of findings.
    """

    done: Mapping[str, str]
    skipped: Mapping[str, str]
    failed: Mapping[str, str]
    out: str
    findings: str

    def __repr__(self) -> str:
        counts = f"{len(self.done)} done, {len(self.skipped)} skipped, {len(self.failed)} failed"
        return f"<tf2_ros.bag.MappedRecordings: {counts}, in {self.out!r}>"


def map_recordings(
    recordings: Recordings,
    target: str,
    source: str,
    out: "str | PathLike[str]",
    *,
    at: str | None = None,
    rate: float | None = None,
    topics: Topics = TOPICS,
    partial: bool = False,
    workers: int | None = None,
    scheduler: "str | Client | None" = None,
    progress: bool | None = None,
) -> MappedRecordings:
    """
    Look up the pose of ``source`` in ``target`` in many recordings, and write a Parquet file for each.

    Its columns are ``file``, ``stamp`` (nanoseconds), ``x y z`` (metres), ``qx qy qz qw`` and ``valid``. What
    is found in the recordings, and what is wrong with those that cannot be read, is in ``_findings.parquet``
    and ``_findings.txt`` of the same folder; nothing that is wrong with one recording stops the others.

    What is done is not done again, unless the recording or the lookup has changed since. Several runs may
    write into one folder.

    :param recordings: a folder, a pattern, a text file of paths, or paths.
    :param out: the folder for the files; it is made where there is none.
    :param at: look up at the stamps of the messages of this topic, which begin with a ``std_msgs/Header``.
    :param rate: look up so many times a second. Without either, at the stamps of the transforms between the
        two frames.
    :param topics: as of :func:`tf2_ros.bag.load`.
    :param partial: use what can be read of a broken recording.
    :param workers: so many processes on this machine; None: one for each core. With 1, and for a single
        recording, this process does the work.
    :param scheduler: the address of a ``dask.distributed`` scheduler, or a ``distributed.Client``: its
        workers do the work. They need this package, and the same folders under the same paths.
    :param progress: whether to show a bar; None: if this takes longer than a second, on a terminal.
    :raises FileNotFoundError: there is no such folder or list, or no recording in it.
    :raises ValueError: ``at`` and ``rate``, or ``workers`` and ``scheduler``, exclude each other; a number is
        below its least value, or ``recordings`` is a file of another kind.
    :raises InvalidArgumentException: a name of a frame is invalid.
    :raises ModuleNotFoundError: a library is not installed, or a worker does not have it.
    """
    if at is not None and rate is not None:
        raise ValueError("at and rate exclude each other")
    if workers is not None and scheduler is not None:
        raise ValueError("workers are processes on this machine; those of a scheduler are its own")
    if workers is not None and workers < 1:
        raise ValueError(f"workers must be at least 1, not {workers}")
    if rate is not None:
        check_rate(rate)
    _check_names(target, source)
    prefixes = None if topics is TOPICS else dict(wanted(topics, None, None).prefixes)
    request = Request(target, source, at, rate, prefixes, partial)
    found = find_recordings(recordings)
    out = os.path.abspath(out)
    os.makedirs(out, exist_ok=True)
    remove_abandoned(out)
    return _run(request, found, out, workers, scheduler, progress)


def _check_names(target: str, source: str) -> None:
    # An invalid name is one in every recording. Here no frame is known, and only the first one is checked.
    for first, second in ((target, source), (source, target)):
        with suppress(LookupException):
            BufferCore().lookup_transform_core(first, second, 0)


def _run(
    request: Request,
    recordings: list[str],
    out: str,
    workers: int | None,
    scheduler: "str | Client | None",
    progress: bool | None,
) -> MappedRecordings:
    tables = {recording: table_of(recording, out) for recording in recordings}
    known = {recording: done_before(request, recording, table) for recording, table in tables.items()}
    ended = {recording: outcome for recording, outcome in known.items() if outcome is not None}
    skipped = {recording: tables[recording] for recording in ended}
    left = {recording: table for recording, table in tables.items() if recording not in ended}
    if skipped and left:
        _write(out, recordings, ended)  # this run may be interrupted, too
    try:
        with progress_bar(out, len(left), " recordings", progress) as count:
            with closing(outcomes(request, left, workers, scheduler)) as results:
                for outcome in _checked(results, left):
                    ended[outcome.recording] = outcome
                    if outcome.problem is not None:
                        _remove_old(outcome.recording, left[outcome.recording])
                    if count is not None:
                        count(1)
    finally:
        findings = _write(out, recordings, ended)
    failed = {path: one.problem for path, one in ended.items() if one.problem is not None}
    done = {path: table for path, table in left.items() if path not in failed}
    return MappedRecordings(done, skipped, failed, out, findings)


def _checked(results: Iterator[Outcome], tables: Mapping[str, str]) -> Iterator[Outcome]:
    for outcome in results:
        table = tables[outcome.recording]
        if outcome.problem is None and not os.path.exists(table):
            raise FileNotFoundError(
                f"a worker has written {table}, but it is not here: is this folder shared?"
            )
        yield outcome


def _remove_old(recording: str, table: str) -> None:
    # It is of another lookup, or of what the recording was before. Not where recordings are deleted when they
    # are done: then nothing else is left.
    if os.path.exists(recording):
        with suppress(FileNotFoundError):
            os.unlink(table)


def _write(out: str, recordings: list[str], ended: Mapping[str, Outcome]) -> str:
    return write_findings(out, [row for path in recordings if path in ended for row in ended[path].found])
