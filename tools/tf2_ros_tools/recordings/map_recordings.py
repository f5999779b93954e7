# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Look up transforms in many recordings in parallel: ``map_recordings``."""

import csv
import errno
import hashlib
import json
import logging
import os
import time
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from io import StringIO
from os import PathLike
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tf2_py import BufferCore, LookupException, TransformException
from tf2_py.printable import printable
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.common.output import counted, write_whole
from tf2_ros_tools.recordings.bag_cache import Cached, state_of
from tf2_ros_tools.recordings.bag_contents import read_contents
from tf2_ros_tools.recordings.bag_loader import (
    TOPICS,
    PoseTopics,
    Topics,
    Urdfs,
    Wanted,
    new_buffer,
    progress_bar,
    wanted,
)
from tf2_ros_tools.recordings.bag_reader import SUFFIXES, UNFINISHED, BagError, resolved
from tf2_ros_tools.recordings.pose_tables import (
    as_parquet,
    look_up_frames,
    metadata_of,
    times_when,
    unset_among,
)
from tf2_ros_tools.recordings.report import report
from tf2_ros_tools.recordings.trajectories import Trajectory

if TYPE_CHECKING:
    from distributed import Client

# Find the recordings.


Recordings: TypeAlias = "str | PathLike[str] | Iterable[str | PathLike[str]]"


def find_recordings(recordings: Recordings) -> list[str]:
    """
    Find recordings; return each once, as an absolute path without symbolic links.

    :param recordings: one or several paths of recordings, or of folders, which are searched with all their
        subfolders.
    :raises FileNotFoundError: no recording was found in the folders.
    """
    paths = [recordings] if isinstance(recordings, str | PathLike) else [*recordings]
    names = [os.fspath(path) for path in paths]
    found = [one for name in names for one in _meant_by(name)]
    if not found:
        raise FileNotFoundError(errno.ENOENT, "no recordings were found", ", ".join(names))
    return list(dict.fromkeys(map(resolved, found)))


def _meant_by(path: str) -> list[str]:
    if not os.path.isdir(path):
        # A part of a folder lacks what the other parts hold.
        folder = os.path.dirname(os.path.abspath(path))
        return [folder if _is_rosbag2(folder) else path]
    found: list[str] = []
    closed: list[str] = []  # folders that cannot be read; returned, so that they are reported as failed
    for folder, inside, files in os.walk(path, onerror=lambda error: closed.append(error.filename)):
        if _is_rosbag2(folder):
            found.append(folder)
            inside.clear()
        else:
            # Those that were not closed are reported as failed.
            ends = (*SUFFIXES, UNFINISHED)
            names = (name for name in files if name.endswith(ends) and not name.startswith("."))
            found += (os.path.join(folder, name) for name in names)
    return sorted(found) + closed


def _is_rosbag2(folder: str) -> bool:
    try:
        with open(os.path.join(folder, "metadata.yaml"), "rb") as file:
            return b"rosbag2_bagfile_information" in file.read(4096)  # other projects use this name, too
    except OSError:
        return False


# Process one recording.


S = 1_000_000_000
# The metadata of a table that says what it was made from. The number changes with the format of this
# metadata or of the table, and with the meaning of a request.
KEY, FORMAT = b"tf2_ros.map_recordings", 8


# A line of the table of findings: file, kind, frame and text. Only the kind "summary" has numbers, too:
# transforms, rows, valid, span_s (of the log times) and seconds (that the recording took).
Row: TypeAlias = "dict[str, Any]"
ERROR = "error"  # the kind of the only row of a recording without a table
UNUSED = "trajectory"  # the kind of the row that counts the poses of a trajectory that are left out


@dataclass(frozen=True)
class Request:
    """
    What is looked up in each recording; :func:`tf2_ros_tools.bag.map_recordings` says what the fields mean.

    :raises ValueError: they are not as described there.
    :raises InvalidArgumentException: a name of a frame is invalid.
    """

    target: str
    source: str | list[str]
    at: str | None
    rate: float | None
    what: Wanted

    def __post_init__(self) -> None:
        if self.at is not None and self.rate is not None:
            raise ValueError("at and rate are mutually exclusive")
        if self.rate is not None and not 0.0 < self.rate < np.inf:
            raise ValueError(f"rate: expected a number above 0 Hz, got {self.rate:g}")
        sources = [self.source] if isinstance(self.source, str) else self.source
        for source in sources:
            # An invalid name is invalid in every recording. An empty buffer checks only the first name.
            for ends in ((self.target, source), (source, self.target)):
                with suppress(LookupException):
                    BufferCore().lookup_transform_core(*ends, 0)
        if not isinstance(self.source, str) and self.at is None:
            raise ValueError("several frames need at, the topic whose stamps are the times")
        if not sources or len(set(sources)) < len(sources):
            raise ValueError(f"frames: expected one or more different names, got {sources!r}")


def table_of(recording: str, out: str) -> str:
    """Get the path of a recording's table, which depends only on the path of the recording."""
    name = os.path.basename(recording)
    stem = name.rpartition(".")[0] if name.endswith(SUFFIXES) else name
    # Programs that read folders ignore names that begin with these characters; a name has at most 255 bytes.
    short = stem.lstrip("._")[:50]
    digest = hashlib.sha256(os.fsencode(recording)).hexdigest()[:12]
    return os.path.join(out, f"{short}-{digest}.parquet".lstrip("-"))


def work(request: Request, recording: str, table: str, cache: str | None = None) -> list[Row]:
    """
    Write the table of one recording in one step; return its findings, of which the first is the summary.

    Problems of the recording itself are findings. All other errors are raised, because the work may succeed
    later, or on another machine.

    :param table: the path of the table; its folder exists.
    :param cache: a folder in which the buffer is frozen, unless it has been.
    """
    begin = time.perf_counter()
    try:
        # Before it is read, because it may change meanwhile.
        made_from = _made_from(request, recording)
        cached = None if cache is None else cached_of(request, recording, cache)
        heard = read_contents(recording, request.what, at=request.at, progress=False, counts_unset=True)
    except BagError as error:
        return [_row(recording, ERROR, str(error))]
    except (FileNotFoundError, PermissionError) as error:
        return [_row(recording, ERROR, f"{error.filename or recording}: {error.strerror}")]
    if cached is not None and not os.path.exists(cached.path):
        cached.write(heard.buffer)
    single = isinstance(request.source, str)
    frames = [request.source] if isinstance(request.source, str) else request.source
    times_ns = np.zeros(0, np.int64) if heard.times_ns is None else heard.times_ns
    if request.at is None:
        with suppress(TransformException):  # look_up_frames says why
            times_ns = times_when(heard, request.target, frames[0], request.rate)
    tables, reasons = look_up_frames(heard, request.target, frames, times_ns)
    lacks = [_row(recording, "lookup", text, "" if single else one) for one, text in reasons.items()]
    answered = np.logical_and.reduce([one.valid for one in tables.values()])
    rows, valid, span_s = len(answered), int(answered.sum()), 0.0
    if heard.start_ns is not None and heard.end_ns is not None:
        span_s = (heard.end_ns - heard.start_ns) / S
    length = f"{counted(len(heard.records), 'transform')} in {span_s:.1f} s"
    summary = _row(recording, "summary", f"{length}, answers at {valid} of {counted(rows, 'time')}")
    summary |= {"transforms": len(heard.records), "rows": rows, "valid": valid, "span_s": span_s}
    if not lacks and valid < rows:
        unset = unset_among(times_ns)
        text = f"no answer at {rows - valid} of {counted(rows, 'time')}{unset and f': {unset}'}"
        lacks = [_row(recording, "lookup", text)]
    problems = [_row(recording, one.kind, one.text, one.frame) for one in report(heard).findings]
    summary["seconds"] = round(time.perf_counter() - begin, 3)
    unused = [_row(recording, UNUSED, text) for text in heard.unused]
    found = [summary, *lacks, *unused, *problems]
    metadata = json.dumps({**made_from, "found": found}).encode()
    columns = {"": tables[frames[0]]} if single else tables
    write_whole(table, as_parquet(columns, printable(recording), {KEY: metadata}))
    return found


def cached_of(request: Request, recording: str, cache: str) -> Cached:
    """Get the frozen file that :func:`tf2_ros_tools.bag.load` opens for a recording."""
    return Cached(cache, recording, request.what.key, new_buffer(None).cache_time_ns)


def done_before(request: Request, recording: str, table: str) -> list[Row] | None:
    """Get the findings of an earlier run with the same request, unless the recording has changed since."""
    try:
        content = json.loads(metadata_of(table)[KEY])
        found: list[Row] = content.pop("found")
        return found if content == _made_from(request, recording) else None
    except (OSError, KeyError, TypeError, ValueError):
        return None  # no table, a table of another program, or a damaged one: it is written again


def _made_from(request: Request, recording: str) -> dict[str, Any]:
    """Get the request, and the state of the recording, which changes with its contents."""
    state = [[printable(name), *facts] for name, *facts in state_of(recording)]
    # As JSON, which has no tuples.
    wanted = {**vars(request), "what": request.what.key}
    content = json.dumps({"request": {"format": FORMAT, **wanted}, "recording": state})
    made_from: dict[str, Any] = json.loads(content)
    return made_from


def _row(recording: str, kind: str, text: str, frame: str = "") -> Row:
    return {"file": printable(recording), "kind": kind, "frame": printable(frame), "text": printable(text)}


# Distribute the work.


# How often Dask repeats work that raised an error, which may be temporary, as with a network folder.
RETRIES = 2
# Only this process handles Ctrl-C; it ends its workers.
IGNORE_INTERRUPT = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"


def outcomes(
    request: Request,
    tables: Mapping[str, str],
    workers: int | None,
    scheduler: "str | Client | None",
    cache: str | None = None,
) -> Generator[tuple[str, list[Row]], None, None]:
    """
    Process recordings, and yield each with its findings as soon as they are known.

    :param tables: maps recordings to the paths of their tables.
    :raises ModuleNotFoundError: a library is not installed in this process or in a worker.
    """
    if scheduler is None and workers is None and len(tables) > 1:
        require("dask", "fleet")
        from dask.system import CPU_COUNT  # knows the limits of a container

        workers = int(CPU_COUNT)
    count = min(workers or 1, len(tables))
    if scheduler is None and count < 2:
        for recording, table in tables.items():
            try:
                yield recording, work(request, recording, table, cache)
            except Exception as error:
                yield recording, _failed(recording, error)
        return
    require("distributed", "fleet")
    from distributed import Client

    if isinstance(scheduler, Client):
        yield from _on_cluster(request, tables, scheduler, cache)
        return
    with local_workers(count) if scheduler is None else Client(scheduler, set_as_default=False) as client:
        yield from _on_cluster(request, tables, client, cache)


@contextmanager
def local_workers(count: int) -> "Iterator[Client]":
    """
    A cluster of this many worker processes on this machine, for a ``with`` statement.

    It listens only on the loopback interface, and has no dashboard. Because it executes what it receives, and
    other users can reach the loopback interface, connecting requires a key that only this process and its
    children have.
    """
    require("distributed", "fleet")
    import dask
    from distributed import Client, LocalCluster

    require("cryptography", "fleet")  # Dask's own error would not name the extra

    settings = {
        # If a recording kills its worker, Dask must not suspect recordings that wait for the same worker.
        "distributed.scheduler.worker-saturation": 1.0,
        # Nor give a worker up that takes longer to start again on a busy machine: nothing would replace it.
        "distributed.deploy.lost-worker-timeout": "1 day",
    }
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            security=True,
            host="127.0.0.1",
            dashboard_address=None,  # pyright: ignore[reportArgumentType]
            # Use any port for health checks: the default is 8787, with a warning if that is in use.
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
            silence_logs=logging.CRITICAL,
            preload=IGNORE_INTERRUPT,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


def _on_cluster(
    request: Request, tables: Mapping[str, str], client: "Client", cache: str | None
) -> Iterator[tuple[str, list[Row]]]:
    from distributed import as_completed

    futures = [
        client.submit(work, request, recording, table, cache, pure=False, retries=RETRIES)
        for recording, table in tables.items()
    ]
    recordings = dict(zip((one.key for one in futures), tables, strict=True))
    try:
        for future in as_completed(futures, loop=client.loop):
            if future.cancelled():
                raise ConnectionError("Dask canceled the work, because the scheduler has ended")
            recording = recordings[future.key]
            try:
                found = future.result()
            except Exception as error:
                found = _failed(recording, error)
            if found[0]["kind"] != ERROR and not os.path.exists(tables[recording]):
                raise FileNotFoundError(
                    f"a worker wrote {tables[recording]}, but this machine cannot see it:"
                    " is the folder shared?"
                )
            yield recording, found
    finally:
        client.cancel(futures)  # what has not begun, if the caller stops early


def _failed(recording: str, error: Exception) -> list[Row]:
    # A problem with one recording does not stop the others, but a library that is not installed stops all.
    if isinstance(error, ModuleNotFoundError):
        raise error
    return [_row(recording, ERROR, f"{type(error).__name__}: {error}")]


# Report the results.


FINDINGS = "_findings.csv"  # programs that read folders ignore names that begin with _
FIELDS: Sequence[str] = ("file", "kind", "frame", "text", "transforms", "rows", "valid", "span_s", "seconds")


def _write_findings(out: str, rows: Sequence[Row]) -> str:
    """Write the findings into a folder; return the path of their table."""
    written = StringIO(newline="")
    table = csv.DictWriter(written, FIELDS)
    table.writeheader()
    table.writerows(rows)
    path = os.path.join(out, FINDINGS)
    write_whole(path, written.getvalue().encode())
    return path


@dataclass(frozen=True, repr=False)
class MappedRecordings:
    """
    The results for many recordings. All paths are absolute.

    :param done: maps the recordings that this run processed to their tables.
    :param skipped: maps the recordings that an earlier run processed to their tables.
    :param failed: maps the recordings that could not be read to the reasons.
    :param unanswered: maps each recording whose table has no answer at any time to the reason.
    :param out: the folder with the tables.
    :param findings: the table of findings, in CSV.
    """

    done: Mapping[str, str]
    skipped: Mapping[str, str]
    failed: Mapping[str, str]
    unanswered: Mapping[str, str]
    out: str
    findings: str

    def __repr__(self) -> str:
        counts = f"{len(self.done)} done, {len(self.skipped)} skipped, {len(self.failed)} failed"
        return f"<tf2_ros_tools.bag.MappedRecordings: {counts}, in {self.out!r}>"


def map_recordings(
    recordings: Recordings,
    target: str,
    source: str | Sequence[str],
    out: "str | PathLike[str]",
    *,
    at: str | None = None,
    rate: float | None = None,
    topics: Topics = TOPICS,
    poses: PoseTopics | None = None,
    urdf: Urdfs = None,
    trajectory: Trajectory | None = None,
    cache: "str | PathLike[str] | None" = None,
    workers: int | None = None,
    scheduler: "str | Client | None" = None,
    progress: bool | None = None,
) -> MappedRecordings:
    """
    Look up the pose of ``source`` in ``target`` in many recordings, and write a Parquet file for each.

    Its columns are ``file``, ``stamp_ns``, ``x y z`` (meters), ``qx qy qz qw``, ``valid``, and
    ``gap``: the seconds between the samples that the pose was interpolated from. The file ``_findings.csv``
    in the same folder lists the problems of the recordings, and why some cannot be read. A problem with one
    recording does not stop the others.

    For several frames, ``source`` is a list of names; this needs ``at``. Each frame then has its own columns,
    ``<frame>.x`` to ``<frame>.gap``.

    A recording that an earlier run has processed is skipped, unless the recording or the lookup has changed.
    Several runs may write into one folder.

    :param recordings: the path of a recording, or of a folder, which is searched with all its subfolders; or
        several of them.
    :param target: the frame in which the poses are given.
    :param source: the frame whose pose is looked up; or a list of frames.
    :param out: the folder for the files; it is created if it does not exist.
    :param at: look up at the stamps of the messages of this topic, which begin with a ``std_msgs/Header``.
    :param rate: look up this many times per second. Without ``at`` and ``rate``, the times are the stamps of
        the transforms between the two frames.
    :param topics: see :func:`tf2_ros_tools.bag.load`.
    :param poses: see :func:`tf2_ros_tools.bag.load`.
    :param urdf: see :func:`tf2_ros_tools.bag.load`.
    :param trajectory: corrects each recording; see :func:`tf2_ros_tools.bag.load`.
    :param cache: a folder in which the transforms of each recording are also frozen, so that ``load`` with
        this folder and the same topics, poses, robots and trajectory opens these files. A recording without
        such a file is not skipped.
    :param workers: the number of worker processes on this machine; None: one for each core. With 1, and for a
        single recording, this process does the work. Python starts the workers with the main module of the
        program, so a script that calls this needs ``if __name__ == "__main__":``.
    :param scheduler: the address of a ``dask.distributed`` scheduler, or a ``distributed.Client``: its
        workers do the work. They need this package, and the same folders under the same paths.
    :param progress: whether to show a bar. None: only if standard error is a terminal, after one second.
    :raises FileNotFoundError: the folders contain no recording, or the file of a trajectory does not exist.
    :raises ValueError: both ``at`` and ``rate``, or both ``workers`` and ``scheduler``, were given; several
        frames have no ``at``; ``rate`` is not above 0; ``workers`` is below 1; or the file of a
        trajectory is broken.
    :raises InvalidArgumentException: a name of a frame is invalid.
    :raises ModuleNotFoundError: a library is not installed, or a worker does not have it.
    """
    source = source if isinstance(source, str) else list(source)
    what = wanted(topics, poses=poses, urdf=urdf, trajectory=trajectory)
    request = Request(target, source, at, rate, what)
    if workers is not None and scheduler is not None:
        raise ValueError("workers and scheduler are mutually exclusive: a scheduler has its own workers")
    if workers is not None and workers < 1:
        raise ValueError(f"workers: expected at least 1, got {workers}")
    paths = find_recordings(recordings)
    out = os.path.abspath(out)
    os.makedirs(out, exist_ok=True)
    tables = {path: table_of(path, out) for path in paths}
    cache = None if cache is None else os.path.abspath(os.fsdecode(cache))
    known = {path: done_before(request, path, table) for path, table in tables.items()}
    for path, rows in known.items():
        # What cannot be found is what an earlier run has left of a recording.
        if cache is not None and rows is not None and os.path.exists(path):
            known[path] = rows if os.path.exists(cached_of(request, path, cache).path) else None
    ended = {path: rows for path, rows in known.items() if rows is not None}
    skipped = {path: tables[path] for path in ended}
    left = {path: table for path, table in tables.items() if path not in ended}
    try:
        with (
            progress_bar("tables", len(left), " recordings", progress) as count,
            closing(outcomes(request, left, workers, scheduler, cache)) as results,
        ):
            for path, rows in results:
                ended[path] = rows
                # An old table belongs to another lookup, or to an earlier state of the recording. If the
                # recording was deleted, keep its table, because nothing else is left.
                if rows[0]["kind"] == ERROR and os.path.exists(path):
                    with suppress(FileNotFoundError):
                        os.unlink(left[path])
                count(1)
    finally:
        findings = _write_findings(out, [row for path in paths for row in ended.get(path, ())])
    failed = {path: rows[0]["text"] for path, rows in ended.items() if rows[0]["kind"] == ERROR}
    done = {path: table for path, table in left.items() if path not in failed}
    # The first row is the summary; the second one says why a lookup has no answer.
    unanswered = {path: str(rows[1]["text"]) for path, rows in ended.items() if rows[0].get("valid") == 0}
    return MappedRecordings(done, skipped, failed, unanswered, out, findings)
