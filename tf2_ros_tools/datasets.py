"""Collect poses at the stamps of images of many recordings, for training: ``dataset``."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from io import BytesIO
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tf2_py import LookupException
from tf2_ros_tools.fleet import KEY, Recordings, Request, Row, find_recordings, looked_up, process
from tf2_ros_tools.loading import TOPICS, PoseTopics, Topics, Urdfs, progress_bar, wanted
from tf2_ros_tools.output import counted, printable, write_whole
from tf2_ros_tools.reading import BagError, needing
from tf2_ros_tools.tables import Table, Tables, columns_of, tables_of

if TYPE_CHECKING:
    from distributed import Client

S = 1_000_000_000


@dataclass(frozen=True, eq=False, repr=False)
class Dataset:
    """
    The poses of F frames at the stamps of N messages of several recordings, in their order.

    It is a sequence of rows, each a dict with the names of LeRobot: ``episode_index``, the number of the
    recording in ``files``; ``frame_index``, the number of the message in the topic; ``timestamp``, the
    seconds since its first message; and ``stamp`` in nanoseconds, ``pose``, ``valid`` and ``gap``, of shape
    (F, 7) or (F,), the numbers as float32. A ``DataLoader`` of torch makes batches of them.

    :param frames: their names.
    :param relative_to: the frame whose coordinates the poses are in.
    :param files: the paths of the recordings.
    :param failed: maps the recordings that could not be read to what is wrong with them.
    :param episodes: indices into ``files``, int64, shape (N,).
    :param indices: the number of the message in its recording, int64, shape (N,).
    :param stamps_ns: int64, shape (N,).
    :param timestamps: seconds since the first message of the recording, float64, shape (N,).
    :param poses: float64, shape (N, F, 7): x y z in metres, qx qy qz qw; NaN without an answer.
    :param valid: bool, shape (N, F): whether there is an answer.
    :param gaps: float64, shape (N, F): seconds between the two samples that the pose was interpolated from,
        the longest of all frames in between; 0 at a sample, NaN without an answer.
    """

    frames: tuple[str, ...]
    relative_to: str
    files: tuple[str, ...]
    failed: Mapping[str, str]
    episodes: NDArray[np.int64]
    indices: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]
    timestamps: NDArray[np.float64]
    poses: NDArray[np.float64]
    valid: NDArray[np.bool_]
    gaps: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __repr__(self) -> str:
        frames, files = counted(len(self.frames), "frame"), counted(len(self.files), "recording")
        return f"<tf2_ros_tools.bag.Dataset: {counted(len(self), 'row')} of {frames} in {files}>"

    def __getitem__(self, row: int) -> dict[str, Any]:
        return {
            "episode_index": int(self.episodes[row]),
            "frame_index": int(self.indices[row]),
            "timestamp": float(self.timestamps[row]),
            "stamp": int(self.stamps_ns[row]),
            "pose": self.poses[row].astype(np.float32),
            "valid": self.valid[row].copy(),
            "gap": self.gaps[row].astype(np.float32),
        }

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (self[row] for row in range(len(self)))

    def where(self, mask: ArrayLike) -> Dataset:
        """Get the rows for which a mask of bools, shape (N,), is true."""
        chosen = np.asarray(mask)
        if chosen.dtype != np.bool_ or chosen.shape != (len(self),):
            raise ValueError(f"mask: expected {len(self)} bools, got {chosen.dtype} of shape {chosen.shape}")
        return replace(self, **{name: getattr(self, name)[chosen] for name in ROWS})

    def save(self, path: str | PathLike[str]) -> None:
        """
        Write a file in one step: ``.npz`` with the fields of this class, or ``.parquet``.

        Parquet has the columns ``file``, ``episode_index``, ``frame_index``, ``timestamp`` and ``stamp``, and
        ``<frame>.x`` to ``<frame>.qw``, ``<frame>.valid`` and ``<frame>.gap`` for each frame.

        :raises ModuleNotFoundError: pyarrow, for Parquet, is not installed.
        :raises ValueError: the name ends differently.
        """
        name = os.fspath(path)
        written = BytesIO()
        if name.endswith(".npz"):
            texts = ("frames", "relative_to", "files")
            arrays: dict[str, Any] = {field: np.asarray(getattr(self, field)) for field in (*texts, *ROWS)}
            np.savez(written, **arrays)
        elif name.endswith(".parquet"):
            with needing("pyarrow", "fleet"):
                import pyarrow
                from pyarrow import parquet
            files = pyarrow.array([printable(one) for one in self.files], pyarrow.string())
            columns = {
                "file": pyarrow.DictionaryArray.from_arrays(self.episodes, files),
                "episode_index": self.episodes,
                "frame_index": self.indices,
                "timestamp": self.timestamps,
            }
            tables = {
                frame: Table(self.stamps_ns, self.poses[:, i], np.ascontiguousarray(self.gaps[:, i]))
                for i, frame in enumerate(self.frames)
            }
            parquet.write_table(pyarrow.table(columns | columns_of(tables)), written)
        else:
            raise ValueError(f"the name of a dataset must end in .parquet or .npz, not {name!r}")
        write_whole(name, written.getvalue())


# The fields with a value for each row.
ROWS = ("episodes", "indices", "stamps_ns", "timestamps", "poses", "valid", "gaps")


def dataset(
    recordings: Recordings,
    frames: Iterable[str],
    *,
    at: str,
    relative_to: str,
    out: str | PathLike[str] | None = None,
    topics: Topics = TOPICS,
    poses: PoseTopics | None = None,
    urdf: Urdfs = None,
    workers: int | None = None,
    scheduler: str | Client | None = None,
    progress: bool | None = None,
) -> Dataset:
    """
    Look up the poses of frames at the stamp of each message of a topic, in one or many recordings.

    :param recordings: see :func:`tf2_ros_tools.bag.map_recordings`.
    :param frames: the names of the frames.
    :param at: the topic, for example of the images; see :func:`tf2_ros_tools.bag.stamps`.
    :param relative_to: the frame in whose coordinates the poses are.
    :param out: a folder, into which :func:`tf2_ros_tools.bag.map_recordings` writes a table of each
        recording, with several processes; the next call reads these tables. None: nothing is written, and
        this process reads the recordings one after the other.
    :param topics: see :func:`tf2_ros_tools.bag.load`.
    :param poses: see the same function.
    :param urdf: see the same function.
    :param workers: see :func:`tf2_ros_tools.bag.map_recordings`; only with ``out``.
    :param scheduler: see the same function; only with ``out``.
    :param progress: see the same function.
    :raises FileNotFoundError: the folder does not exist, or contains no recording.
    :raises BagError: none of the recordings can be read.
    :raises LookupException: a frame has no pose at any time in any recording.
    :raises InvalidArgumentException: a name of a frame is invalid.
    :raises TypeError, ValueError: ``frames`` is a str, is empty or has equal names; or see
        :func:`tf2_ros_tools.bag.load`.

    A recording that cannot be read does not stop the others; ``failed`` lists it.
    """
    if isinstance(frames, str):
        raise TypeError(f"frames must be several names, use [{frames!r}]")
    names = list(frames)
    if out is None and (workers is not None or scheduler is not None):
        raise ValueError("workers and scheduler need a folder for the tables, out")
    request = Request(relative_to, names, at, None, wanted(topics, poses=poses, urdf=urdf))
    if out is None:
        parts, failed = _read_here(request, find_recordings(recordings), progress)
    else:
        result = process(request, recordings, out, workers, scheduler, progress)
        failed = dict(result.failed)
        tables = {**result.done, **result.skipped}
        parts = {path: _read_table(names, tables[path]) for path in sorted(tables)}
    if not parts:
        path, problem = next(iter(failed.items()))
        raise BagError(problem if path in problem else f"{printable(path)}: {problem}")
    every = [tables for tables, _ in parts.values()]
    stamps = [tables[names[0]].stamps_ns for tables in every]
    counts = [len(one) for one in stamps]

    def joined(column: str) -> NDArray[Any]:
        rows = [np.stack([getattr(tables[name], column) for name in names], axis=1) for tables in every]
        return np.concatenate(rows)

    made = Dataset(
        frames=tuple(names),
        relative_to=relative_to,
        files=tuple(parts),
        failed=failed,
        episodes=np.repeat(np.arange(len(parts)), counts),
        indices=np.concatenate([np.arange(count) for count in counts]),
        stamps_ns=np.concatenate(stamps),
        timestamps=np.concatenate([(one - one[:1]) / S for one in stamps]),
        poses=joined("poses"),
        valid=joined("valid"),
        gaps=joined("gaps"),
    )
    for i, name in enumerate(names):
        if len(made) and not made.valid[:, i].any():
            reasons = [reason[name] for _, reason in parts.values() if name in reason]
            raise LookupException(reasons[0] if reasons else f"{name!r} has no pose at any stamp of {at}")
    return made


Parts = dict[str, tuple[Tables, dict[str, str]]]  # by recording, with why frames have no answer


def _read_here(
    request: Request, recordings: list[str], progress: bool | None
) -> tuple[Parts, dict[str, str]]:
    parts: Parts = {}
    failed: dict[str, str] = {}
    with progress_bar("dataset", len(recordings), " recordings", progress) as count:
        for path in recordings:
            try:
                _, tables, lacks = looked_up(request, path)
                parts[path] = tables, _reasons(lacks)
            except BagError as error:
                failed[path] = str(error)
            except OSError as error:
                failed[path] = f"{error.filename or path}: {error.strerror}"
            count(1)
    return parts, failed


def _read_table(frames: list[str], path: str) -> tuple[Tables, dict[str, str]]:
    from pyarrow import parquet

    table = parquet.read_table(path)
    columns = {name: table[name].to_numpy() for name in table.column_names if name != "file"}
    return tables_of(frames, columns), _reasons(json.loads(table.schema.metadata[KEY])["found"])


def _reasons(found: Iterable[Row]) -> dict[str, str]:
    return {row["frame"]: row["text"] for row in found if row["kind"] == "lookup"}
