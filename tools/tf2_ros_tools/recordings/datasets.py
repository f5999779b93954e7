# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Collect poses at the stamps of images of many recordings, for training: ``dataset``."""

from __future__ import annotations

import errno
import os
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tf2_py import BufferCore, LookupException
from tf2_py.printable import counted, printable
from tf2_ros_tools.common.output import write_whole
from tf2_ros_tools.recordings.bag_loader import (
    TOPICS,
    PoseTopics,
    Topics,
    Urdfs,
    progress_bar,
    read_contents,
    wanted,
)
from tf2_ros_tools.recordings.bag_reader import SUFFIXES, UNFINISHED, BagError, resolved
from tf2_ros_tools.recordings.header_stamps import UNSET_NS
from tf2_ros_tools.recordings.pose_tables import STAMP_NS, Table, as_parquet, look_up_table
from tf2_ros_tools.recordings.trajectories import Trajectory

S = 1_000_000_000
FLOAT32_M = 2.0**15  # float32 rounds smaller coordinates by less than 1 mm

# Find the recordings.


Recordings: TypeAlias = str | PathLike[str] | Iterable[str | PathLike[str]]


def find_recordings(recordings: Recordings) -> list[str]:
    """
    Find recordings; return each once, as an absolute path, of the target of links if it has the extension.

    :param recordings: one or several paths of recordings, or of folders, which are searched with all their
        subfolders, but not with linked ones.
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


# Collect the poses.


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
    :param timestamps: seconds since the topic's first stamp in the recording, float64, shape (N,); NaN
        without a stamp.
    :param poses: float64, shape (N, F, 7): x y z in meters, qx qy qz qw, with the sign that is closer to the
        row before; NaN without an answer.
    :param valid: bool, shape (N, F): whether there is an answer.
    :param gaps: float64, shape (N, F): seconds between the two samples that the pose was interpolated from,
        the longest of all frames in between but one that a trajectory corrects; 0 at a sample, NaN without an
        answer.
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
        :raises ModuleNotFoundError: pyarrow is not installed.
        """
        numbers = {
            "episode_index": self.episodes,
            "frame_index": self.indices,
            "timestamp": self.timestamps,
        }
        prefixes = [f"{frame}." for frame in self.frames]
        table = Table(self.stamps_ns, self.poses, self.gaps)
        write_whole(path, as_parquet(table, self.files, self.episodes, numbers, prefixes))


# The fields with a value for each row.
ROWS = ("episodes", "indices", "stamps_ns", "timestamps", "poses", "valid", "gaps")


def dataset(
    recordings: Recordings,
    frames: Iterable[str],
    *,
    at: str,
    relative_to: str,
    topics: Topics = TOPICS,
    poses: PoseTopics | None = None,
    urdf: Urdfs = None,
    trajectory: Trajectory | None = None,
    progress: bool | None = None,
) -> Dataset:
    """
    Look up the poses of frames at the stamp of each message of a topic, in one or many recordings.

    :param recordings: the path of a recording, or of a folder, which is searched with all its subfolders, but
        not linked ones; or several of them.
    :param frames: the names of the frames.
    :param at: the topic, for example of the images; see :func:`tf2_ros_tools.bag.stamps`.
    :param relative_to: the frame in which the poses are given.
    :param topics: see :func:`tf2_ros_tools.bag.load`.
    :param poses: see :func:`tf2_ros_tools.bag.load`.
    :param urdf: see :func:`tf2_ros_tools.bag.load`.
    :param trajectory: see :func:`tf2_ros_tools.bag.load`.
    :param progress: whether to show a bar. None: only if standard error is a terminal, after one second.
    :raises FileNotFoundError: the folders contain no recording.
    :raises BagError: none of the recordings can be read.
    :raises LookupException: a frame has no pose at any time in any recording.
    :raises InvalidArgumentException: a name of a frame is invalid.
    :raises TypeError, ValueError: ``frames`` is a str, is empty or has equal names; or see
        :func:`tf2_ros_tools.bag.load`.

    A recording that cannot be read does not stop the others; ``failed`` lists it. The warnings are those of
    :func:`tf2_ros_tools.bag.load`.
    """
    if isinstance(frames, str):
        raise TypeError(f"frames: expected a list of names, got a str: use [{frames!r}]")
    names = list(frames)
    if not names or len(set(names)) < len(names):
        raise ValueError(f"frames: expected one or more different names, got {names!r}")
    for name in names:
        # An invalid name is invalid in every recording. An empty buffer checks only the first name.
        for ends in ((relative_to, name), (name, relative_to)):
            with suppress(LookupException):
                BufferCore().lookup_transform_core(*ends, 0)
    what = wanted(topics, poses=poses, urdf=urdf, trajectory=trajectory)
    paths = find_recordings(recordings)
    found: dict[str, Table] = {}
    failed: dict[str, str] = {}
    reasons: dict[str, str] = {}  # of the first recording with stamps in which a frame has no pose
    notes: list[str] = []
    with progress_bar("dataset", len(paths), " recordings", progress) as count:
        for path in paths:
            try:
                heard = read_contents(path, what, at=at, progress=False)
                assert heard.times_ns is not None
                found[path], lacks = look_up_table(heard, relative_to, names, heard.times_ns)
            except BagError as error:
                failed[path] = printable(str(error))
            except OSError as error:
                failed[path] = printable(f"{error.filename or path}: {error.strerror or error}")
            else:
                if len(found[path]):
                    reasons = {**lacks, **reasons}
                notes += (printable(f"{path}: {text}") for text in heard.warnings)
                del heard  # its memory is free before the next recording is read
            count(1)
    for text in notes:
        warnings.warn(text, stacklevel=2)
    if not found:
        path, problem = next(iter(failed.items()))
        raise BagError(problem if path in problem else f"{printable(path)}: {problem}")
    stamps = [one.stamps_ns for one in found.values()]
    counts = [*map(len, stamps)]
    made = Dataset(
        frames=tuple(names),
        relative_to=relative_to,
        files=tuple(found),
        failed=failed,
        episodes=np.repeat(np.arange(len(found)), counts),
        indices=np.concatenate([np.arange(count) for count in counts]),
        stamps_ns=np.concatenate(stamps),
        timestamps=np.concatenate([*map(_since_first, stamps)]),
        poses=np.concatenate([one.poses for one in found.values()]),
        valid=np.concatenate([one.valid for one in found.values()]),
        gaps=np.concatenate([one.gaps for one in found.values()]),
    )
    for i, name in enumerate(names):
        if len(made) and not made.valid[:, i].any():
            reason = printable(reasons[name])
            raise LookupException(f"{name!r} has no pose at any stamp of {at}: {reason}")
    return made


def _since_first(stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """The seconds since the first stamp that is set; NaN for those that are not."""
    is_set = stamps_ns != UNSET_NS
    first = stamps_ns[is_set][:1].sum()
    seconds: NDArray[np.float64] = np.where(is_set, (stamps_ns - first) / S, np.nan)
    return seconds
