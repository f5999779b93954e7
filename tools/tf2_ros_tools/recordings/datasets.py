# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Collect poses at the stamps of images of many recordings, for training: ``dataset``."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from io import BytesIO
from os import PathLike
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tf2_py import LookupException
from tf2_py.printable import printable
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.common.output import counted, write_whole
from tf2_ros_tools.recordings.bag_loader import TOPICS, PoseTopics, Topics, Urdfs
from tf2_ros_tools.recordings.bag_reader import BagError
from tf2_ros_tools.recordings.header_stamps import UNSET_NS
from tf2_ros_tools.recordings.map_recordings import (
    UNUSED,
    Recordings,
    find_recordings,
    map_recordings,
)
from tf2_ros_tools.recordings.pose_tables import POSE, STAMP_NS
from tf2_ros_tools.recordings.trajectories import Trajectory

if TYPE_CHECKING:
    from distributed import Client

S = 1_000_000_000
FLOAT32_M = 2.0**15  # float32 rounds smaller coordinates by less than 1 mm


@dataclass(frozen=True, eq=False, repr=False)
class Dataset:
    """
    The poses of F frames at the stamps of N messages of several recordings, in their order.

    It is a sequence of rows, each a dict with LeRobot's keys: ``episode_index``, the number of the
    recording in ``files``; ``frame_index``, the number of the message in the topic; ``timestamp``, the
    seconds since its first message; and ``stamp_ns``, ``pose``, ``valid`` and ``gap``, of shape
    (F, 7) or (F,), the numbers as float32. If a coordinate is 32,768 m or larger, as in UTM, float32
    would round it by more than 1 mm, and the poses of all rows are float64. A ``DataLoader`` of torch makes
    batches of them.

    :param frames: their names.
    :param relative_to: the frame in which the poses are given.
    :param files: the paths of the recordings, each once, in the order in which they were passed; those in a
        folder are sorted.
    :param failed: maps the recordings that could not be read to the reasons.
    :param episodes: indices into ``files``, int64, shape (N,).
    :param indices: the number of the message in its recording, int64, shape (N,).
    :param stamps_ns: int64, shape (N,). The smallest int64, NaT, if the stamp of a message is not set: such
        a row has no answer.
    :param timestamps: seconds since the first message of the recording that has a stamp, float64, shape (N,);
        NaN without a stamp.
    :param poses: float64, shape (N, F, 7): x y z in meters, qx qy qz qw, with the sign that is closer to the
        row before; NaN without an answer.
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
            STAMP_NS: int(self.stamps_ns[row]),
            "pose": self.poses[row].astype(self._pose_dtype),
            "valid": self.valid[row].copy(),
            "gap": self.gaps[row].astype(np.float32),
        }

    @cached_property
    def _pose_dtype(self) -> type[np.floating[Any]]:
        # One for all rows, because a batch has one.
        is_far = np.abs(self.poses[..., :3]) >= FLOAT32_M  # false for NaN
        return np.float64 if is_far.any() else np.float32

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (self[row] for row in range(len(self)))

    def where(self, mask: ArrayLike) -> Dataset:
        """
        Get the rows for which a mask is true.

        :param mask: bools, shape (N,).
        :return: a new data set.
        :raises TypeError: ``mask`` does not consist of bools.
        :raises IndexError: ``mask`` has another shape.
        """
        chosen = np.asarray(mask).astype(np.bool_, casting="no")  # not indices
        return replace(self, **{name: getattr(self, name)[chosen] for name in ROWS})

    def save(self, path: str | PathLike[str]) -> None:
        """
        Write a Parquet file in one step.

        It has the columns ``file``, ``episode_index``, ``frame_index``, ``timestamp`` and ``stamp_ns``, and
        ``<frame>.x`` to ``<frame>.qw``, ``<frame>.valid`` and ``<frame>.gap`` for each frame.

        :param path: the file.
        :raises OSError: the file cannot be written; an existing file remains unchanged.
        """
        import pyarrow
        from pyarrow import parquet

        files = pyarrow.array([printable(one) for one in self.files], pyarrow.string())
        columns: dict[str, Any] = {
            "file": pyarrow.DictionaryArray.from_arrays(self.episodes, files),
            "episode_index": self.episodes,
            "frame_index": self.indices,
            "timestamp": self.timestamps,
            STAMP_NS: self.stamps_ns,
        }
        for i, frame in enumerate(self.frames):
            columns |= {f"{frame}.{name}": self.poses[:, i, j].copy() for j, name in enumerate(POSE)}
            columns |= {f"{frame}.valid": self.valid[:, i].copy(), f"{frame}.gap": self.gaps[:, i].copy()}
        written = BytesIO()
        parquet.write_table(pyarrow.table(columns), written)
        write_whole(path, written.getvalue())


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
    trajectory: Trajectory | None = None,
    cache: str | PathLike[str] | None = None,
    workers: int | None = None,
    scheduler: str | Client | None = None,
    progress: bool | None = None,
) -> Dataset:
    """
    Look up the poses of frames at the stamp of each message of a topic, in one or many recordings.

    :param recordings: see :func:`tf2_ros_tools.bag.map_recordings`.
    :param frames: the names of the frames.
    :param at: the topic, for example of the images; see :func:`tf2_ros_tools.bag.stamps`.
    :param relative_to: the frame in which the poses are given.
    :param out: a folder, into which :func:`tf2_ros_tools.bag.map_recordings` writes a table of each
        recording, with several processes; the next call reads these tables. None: no table is kept, and this
        process reads the recordings one after the other.
    :param topics: see :func:`tf2_ros_tools.bag.load`.
    :param poses: see :func:`tf2_ros_tools.bag.load`.
    :param urdf: see :func:`tf2_ros_tools.bag.load`.
    :param trajectory: see :func:`tf2_ros_tools.bag.load`.
    :param cache: see :func:`tf2_ros_tools.bag.map_recordings`.
    :param workers: only with ``out``; the number of worker processes. None: one for each core.
    :param scheduler: only with ``out``; the address of a Dask scheduler, whose workers do the work.
    :param progress: whether to show a bar. None: only if standard error is a terminal, after one second.
    :raises FileNotFoundError: the folders contain no recording.
    :raises BagError: none of the recordings can be read.
    :raises LookupException: a frame has no pose at any time in any recording.
    :raises InvalidArgumentException: a name of a frame is invalid.
    :raises ModuleNotFoundError: pyarrow is not installed.
    :raises TypeError, ValueError: ``frames`` is a str, is empty or has equal names; or see
        :func:`tf2_ros_tools.bag.load`.

    A recording that cannot be read does not stop the others; ``failed`` lists it. A warning counts the poses
    of a trajectory that are left out.
    """
    if isinstance(frames, str):
        raise TypeError(f"frames: expected a list of names, got a str: use [{frames!r}]")
    names = list(frames)
    if out is None and (workers is not None or scheduler is not None):
        raise ValueError("workers and scheduler need out, the folder for the tables")
    require("pyarrow", "fleet")
    import pyarrow
    from pyarrow import parquet

    with TemporaryDirectory(prefix="tf2-ros-cython-") as folder:
        # For their order, which is that of labels, too.
        paths = find_recordings(recordings)
        result = map_recordings(
            paths,
            relative_to,
            names,
            folder if out is None else out,
            at=at,
            topics=topics,
            poses=poses,
            urdf=urdf,
            trajectory=trajectory,
            cache=cache,
            workers=1 if out is None else workers,
            scheduler=scheduler,
            progress=progress,
        )
        with open(result.findings, encoding="utf-8", newline="") as file:
            unused = [row for row in csv.DictReader(file) if row["kind"] == UNUSED]
        written = {**result.done, **result.skipped}
        tables = {path: parquet.read_table(written[path]) for path in paths if path in written}
    for row in unused:
        warnings.warn(f"{row['file']}: {row['text']}", stacklevel=2)
    if not tables:
        path, problem = next(iter(result.failed.items()))
        raise BagError(problem if path in problem else f"{printable(path)}: {problem}")
    whole = pyarrow.concat_tables(tables.values())
    stamps = [table[STAMP_NS].to_numpy() for table in tables.values()]
    counts = [*map(len, stamps)]

    def columns(name: str) -> NDArray[Any]:
        return np.stack([whole[f"{frame}.{name}"].to_numpy() for frame in names], axis=1)

    made = Dataset(
        frames=tuple(names),
        relative_to=relative_to,
        files=tuple(tables),
        failed=dict(result.failed),
        episodes=np.repeat(np.arange(len(tables)), counts),
        indices=np.concatenate([np.arange(count) for count in counts]),
        stamps_ns=np.concatenate(stamps),
        timestamps=np.concatenate([*map(_since_first, stamps)]),
        poses=np.stack([columns(name) for name in POSE], axis=2),
        valid=columns("valid"),
        gaps=columns("gap"),
    )
    for i, name in enumerate(names):
        if len(made) and not made.valid[:, i].any():
            reason = next(iter(result.unanswered.values()))
            raise LookupException(f"{name!r} has no pose at any stamp of {at}: {reason}")
    return made


def _since_first(stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """The seconds since the first stamp that is set; NaN for those that are not."""
    is_set = stamps_ns != UNSET_NS
    first = stamps_ns[is_set][:1].sum()
    seconds: NDArray[np.float64] = np.where(is_set, (stamps_ns - first) / S, np.nan)
    return seconds
