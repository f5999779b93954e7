# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correct a recording by a trajectory, the poses at keyframes that a SLAM has exported or published."""

import errno
import os
import reprlib
from array import array
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tf2_py import BufferCore, ExtrapolationException, History, TransformException, stored_name
from tf2_py.printable import counted, printable
from tf2_py.typing import TimeLike, TimesLike
from tf2_ros.correction import correct
from tf2_ros.numpy import to_arrays, to_matrix, to_nanoseconds
from tf2_ros.serialization import serialize_arrays
from tf2_ros_tools.recordings.bag_reader import BagError, Raw, Recorded, as_time_ns, listed, typestore
from tf2_ros_tools.recordings.joints_and_poses import NAMED, PATH, POSE_ARRAY, POSES, poses_of
from tf2_ros_tools.recordings.pose_files import (
    LAST_NS,
    StampedPoses,
    columns_of,
    read_kitti,
    read_table,
    read_times,
)

S = 1_000_000_000
# How far a stamp may be from the one that was rounded: many programs write microseconds.
ROUNDED_NS = 1_000
SAME = 1e-9  # poses are the same if no number of their matrices differs by more, as for `correct`
BEFORE_CLOCKS_NS = 10**8 * S  # in 1973: earlier stamps are relative, or of a simulation
# The types of topics with poses.
TYPES = (PATH, *NAMED, *POSES, POSE_ARRAY)
RECORDING = "recording"  # as a start


@dataclass(frozen=True, eq=False)  # arrays are not equal or unequal
class Trajectory:
    """
    Poses of a frame at keyframes, by which :func:`tf2_ros_tools.bag.load` corrects a recording.

    :param path: one of

        - a file with a row for each pose, in any order. Its columns are those of ``columns``, or else of a
          first line with their names, or of the format of the TUM RGB-D benchmark, which evo and most SLAMs
          write: stamp (seconds) x y z (meters) qx qy qz qw. See the page about recordings;
        - with ``times``, a file in the format of KITTI: lines of 12 numbers, the first three rows of a
          homogeneous matrix, in meters;
        - with ``times``, arrays: a tuple ``(translations, rotations)``, or matrices of shape (N, 4, 4), as
          for :func:`tf2_ros.numpy.to_matrix` and :func:`tf2_ros.numpy.to_arrays`;
        - a topic of the recording, if no file has this name: a str. Of a ``nav_msgs/Path``, the last message
          counts. All messages count of ``nav_msgs/Odometry``, ``geometry_msgs/PoseStamped``,
          ``geometry_msgs/PoseWithCovarianceStamped`` and ``geometry_msgs/TransformStamped``, whatever the
          ``start`` and ``end`` of ``load`` are. The last ``geometry_msgs/PoseArray`` counts, with ``times``.

    :param parent: the frame in which the poses are given, such as ``map``.
    :param child: the frame whose transform from ``parent`` is replaced, such as ``odom``.
    :param moving: the frame whose poses are given, such as ``base_link``.
    :param before: see :func:`tf2_ros.correction.correct`.
    :param after: see the same function.
    :param on_missing: see the same function. At least one pose must be used.
    :param times: the stamps of the poses of KITTI, arrays or a ``PoseArray``: N times, as for
        ``Buffer.lookup_transforms``, such as those of ``bag.stamps``; or a file with a line for each, in
        seconds, or in the unit that its heading names, such as ``timestamp [ns]``.
    :param start: a time that is added to all stamps of files, if they count from a start; ``"recording"``:
        the first log time of the recording. None: they are those of the recording's clock.
    :param columns: the names of all columns of a file, such as ``timestamp_us - x y z qw qx qy qz``; ``-`` is
        a column that is not needed, ``...`` at the end any number of them. A heading is then skipped.
    :raises TypeError, ValueError: a path or the name of a frame is something else, ``start`` is not a time,
        or ``columns`` does not name each of the eight once.

    The pose that is closest to the first odometry is used there if it is at most 1 µs away, because its stamp
    may be rounded; and so at the last one.
    """

    path: str | PathLike[str] | tuple[ArrayLike, ArrayLike] | ArrayLike
    parent: str
    child: str
    moving: str
    before: Literal["keep", "hold"] = "keep"
    after: Literal["keep", "hold"] = "hold"
    on_missing: Literal["raise", "skip"] = "raise"
    times: str | PathLike[str] | TimesLike | None = None
    start: TimeLike | Literal["recording"] | None = None
    columns: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.path, str | PathLike) and self.times is None:
            given = reprlib.repr(self.path)
            raise TypeError(f"path: expected a str, a path, or arrays with `times`, got {given}")
        if self.columns is not None:
            columns_of(self.columns)
            if self.times is not None:
                raise ValueError("columns: not for poses with `times`")
        for name in ("parent", "child", "moving"):
            if not isinstance(frame := getattr(self, name), str):
                raise TypeError(f"{name}: expected a str, the name of a frame, got {frame!r}")
        if isinstance(self.start, str):
            if self.start != RECORDING:
                raise ValueError(f"start: expected a time or {RECORDING!r}, got {self.start!r}")
        elif self.start is not None:
            as_time_ns("start", self.start)


class Keyframes:
    """
    The poses of a trajectory: what its files contain now, or a topic of recordings.

    ``child`` is the frame whose transform they replace, as buffers store its name. ``topic`` has the poses;
    None: a file does.

    :raises TypeError: it is not a ``Trajectory``.
    :raises FileNotFoundError, OSError: a file cannot be read.
    :raises BagError: a file does not have the format.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        if not isinstance(trajectory, Trajectory):
            raise TypeError(f"trajectory: expected a Trajectory, got {type(trajectory).__name__}")
        self._trajectory, path, times = trajectory, trajectory.path, trajectory.times
        self._name = _name_of("path", path)
        self.child = stored_name(trajectory.child)
        self.topic = path if isinstance(path, str) and not os.path.exists(path) else None
        self._given: StampedPoses | None = None
        self._times_ns: NDArray[np.int64] | None = None
        if times is not None:
            self._times_ns = read_times(times) if isinstance(times, str | PathLike) else to_nanoseconds(times)
        if not isinstance(path, str | PathLike):
            self._given = _of_arrays(path, self._times_ns)
        elif self.topic is None and self._times_ns is not None:
            self._given = read_kitti(path, self._times_ns, _name_of("times", times))
        elif self.topic is None:
            self._given = read_table(path, trajectory.columns)

    def read(self, recorded: Recorded, prefix: str = "") -> StampedPoses:
        """
        Get the poses for a recording.

        :param prefix: of the frames of the topic, if their names are those of the recording.
        :raises FileNotFoundError: there is neither a file nor a topic with this name.
        :raises BagError: the topic has no such poses, or a stamp is too large.
        """
        poses = self._given or self._of_topic(recorded, prefix)
        start = self._trajectory.start
        if start is None:
            return poses
        if self._given is None and self._times_ns is None:
            raise BagError(f"{poses.name}: `start` is for the stamps of files, which may count from a start")
        start_ns = recorded.start_ns or 0
        if not isinstance(start, str):
            start_ns = as_time_ns("start", start)
        late = np.flatnonzero(poses.times_ns > LAST_NS - start_ns)
        if late.size:
            first = int(late[0])
            place, stamp = poses.place(first), _seconds(int(poses.times_ns[first]))
            raise BagError(f"{place}: the stamp {stamp} is too large to count from {_seconds(start_ns)}")
        return replace(poses, times_ns=poses.times_ns + start_ns)

    def _of_topic(self, recorded: Recorded, prefix: str) -> StampedPoses:
        topic, msgtype = str(self.topic), self._type_of_topic(recorded)
        name, read = f"{printable(recorded.path)}, topic {printable(topic)}", typestore().deserialize_cdr
        messages: Iterable[tuple[int, Raw]]
        if has_several := msgtype in (PATH, POSE_ARRAY):
            last = recorded.last(topic)
            messages = [] if last is None else [last]
        else:
            messages = ((log_ns, raw) for _, log_ns, raw in recorded.checked(recorded.raw([topic])))
        of, stamps_ns, rows = "pose" if has_several else "message", array("q"), array("d")
        for log_ns, raw in messages:
            try:
                poses = [*poses_of(msgtype, read(raw, msgtype))]
            except Exception as error:  # rosbags defines an error class only for some kinds of damage
                recorded.malformed(topic, log_ns, error)
            for stamp_ns, frames, numbers in poses:
                stamps_ns.append(stamp_ns)
                rows.extend(numbers)
                self._check_frames(f"{name}, {of} {len(stamps_ns)}", frames, prefix)
        count = len(stamps_ns)
        if not count:
            has_messages = recorded.topics[topic].count > 0
            raise BagError(
                f"{name}: {'its last message has no poses' if has_messages else 'it has no messages'}"
            )
        times_ns = np.array(stamps_ns) if self._times_ns is None else self._times_ns
        if len(times_ns) != count:
            times = _name_of("times", self._trajectory.times)
            raise BagError(
                f"expected a stamp for each of the {count} poses in {name}, got {len(times_ns)} in {times}"
            )
        translations, rotations = np.split(np.array(rows).reshape(-1, 7), [3], axis=1)
        found = StampedPoses(name, of, np.arange(1, count + 1), times_ns, translations, rotations)
        found.check()
        return found

    def _type_of_topic(self, recorded: Recorded) -> str:
        topic, path = str(self.topic), printable(recorded.path)
        if topic not in recorded.topics:
            others = listed(one.name for one in recorded.topics.values() if one.msgtype in TYPES)
            raise FileNotFoundError(
                errno.ENOENT,
                f"neither a file nor a topic of {path}, whose topics with poses are: {others}",
                topic,
            )
        if self._trajectory.columns is not None:
            raise BagError(f"{path}, topic {printable(topic)}: `columns` is for files")
        msgtype = recorded.topics[topic].msgtype
        if msgtype not in TYPES:
            raise BagError(
                f"{path}, topic {printable(topic)}: expected the type {', '.join(TYPES[:-1])} or {TYPES[-1]},"
                f" got {printable(msgtype)}"
            )
        if (msgtype == POSE_ARRAY) != (self._times_ns is not None):
            text = "poses of a PoseArray have no stamps: pass them as `times` or --trajectory-times"
            if self._times_ns is not None:
                text = f"the poses of a {msgtype} have stamps; `times` is not for them"
            raise BagError(f"{path}, topic {printable(topic)}: {text}")
        return msgtype

    def _check_frames(self, where: str, frames: tuple[str, str], prefix: str) -> None:
        """Refuse a pose whose frames, unless they are empty, are not those of the trajectory."""
        for given, wanted, role in zip(
            frames, (self._trajectory.parent, self._trajectory.moving), ("parent", "moving"), strict=True
        ):
            named = stored_name(given)
            if named and stored_name(wanted) not in (named, prefix + named):
                kind = "in" if role == "parent" else "of"
                raise BagError(
                    f"{where}: expected a pose {kind} {wanted!r}, got one {kind} {prefix + named!r}; to use"
                    f" it, pass this name as {role}"
                )

    def correct(self, buffer: BufferCore, poses: StampedPoses) -> list[str]:
        """
        Correct the buffer of a recording.

        :param poses: those that :meth:`read` has returned.
        :return: a sentence if poses are left out.
        :raises BagError: a pose cannot be used, or none can; or the frames are wrong.
        """
        one, times_ns = self._trajectory, self._at_ends(buffer, poses.times_ns)
        repeats, different = _of_equal_stamps(poses, skips=one.on_missing == "skip")
        self._refuse_relative(buffer, poses)
        what = buffer, one.parent, one.child, one.moving, times_ns, (poses.translations, poses.rotations)
        how: dict[str, Any] = {"before": one.before, "after": one.after}
        none = ""
        try:
            used = correct(*what, **how, on_missing=one.on_missing)
            if not used:
                none = "none of its poses can be used: "
                correct(*what, **how)  # says why
        except (TransformException, ValueError) as error:
            at_ends = replace(poses, times_ns=times_ns)
            if none:
                self._refuse_outside(buffer, at_ends, none)
            self._refuse(buffer, at_ends, none, error)
        left_out, unset = len(poses) - repeats - used, int((times_ns == 0).sum())
        if not left_out:
            return []
        reasons = [f"{printable(one.moving)} in {printable(one.child)} is not known then or no longer kept"]
        reasons = reasons * (left_out > unset + different)
        reasons += ["the stamp is 0"] * bool(unset) + ["others with the same stamp differ"] * bool(different)
        are = "is" if left_out == 1 else "are"
        of = f"{left_out} of the {counted(len(poses), 'pose')} in {self._name}"
        return [f"{of} {are} left out, because {' or '.join(reasons)}"]

    def played(self, buffer: BufferCore) -> tuple[History, list[str], list[str]]:
        """
        Get the samples of the corrected frame for a player, the frames of the odometry, and those that move.

        When a recording is played, a transform arrives at its stamp. Without a sample at each stamp of the
        odometry, which changes no answer, a viewer could not show the robot before the next keyframe.

        :param buffer: has been corrected; the samples are inserted into it.
        """
        parent, moving = stored_name(self._trajectory.parent), stored_name(self._trajectory.moving)
        histories = buffer.histories()
        keyframes_ns = histories[self.child].stamps_ns
        chain = self._chain(buffer, keyframes_ns, moving)
        moved = [name for name in chain if name in histories and not histories[name].static]
        stamps_ns = np.unique(np.concatenate([histories[name].stamps_ns for name in moved] or [keyframes_ns]))
        is_inside = (stamps_ns > keyframes_ns[0]) & (stamps_ns < keyframes_ns[-1])
        times_ns = stamps_ns[is_inside & ~np.isin(stamps_ns, keyframes_ns)]
        found = np.hstack(buffer.lookup_transforms(parent, self.child, times_ns, on_missing="nan"))
        known = ~np.isnan(found[:, 0])
        frames = [(parent, self.child)] * int(known.sum())
        buffer.set_transforms_cdr(
            serialize_arrays(frames, times_ns[known], found[known]), "tf2_ros.correction"
        )
        return buffer.histories()[self.child], chain, moved

    def _chain(self, buffer: BufferCore, times_ns: NDArray[np.int64], moving: str) -> list[str]:
        """Get the frames from below the one that is corrected to the one whose poses are known."""
        for time_ns in times_ns.tolist():  # at some, the odometry is not known, or has another parent
            with suppress(TransformException):
                return [name for name in buffer.path(self.child, moving, time_ns) if name != self.child]
        return []

    def _at_ends(self, buffer: BufferCore, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Move the closest times to the ends of the odometry, if their stamps may be rounded."""
        times_ns = times_ns.copy()
        with suppress(TransformException):  # there is no odometry
            for end_ns in buffer.time_range(self._trajectory.child, self._trajectory.moving):
                closest_ns = times_ns[np.abs(times_ns - end_ns).argmin()]
                if abs(closest_ns - end_ns) <= ROUNDED_NS:
                    times_ns[times_ns == closest_ns] = end_ns
        return times_ns

    def _refuse_relative(self, buffer: BufferCore, poses: StampedPoses) -> None:
        """Refuse stamps of a file that count from a start which is not known."""
        last_ns = int(poses.times_ns.max())
        if self._trajectory.start is not None or poses.of != "line" or last_ns > BEFORE_CLOCKS_NS:
            return
        with suppress(TransformException):  # there is no odometry
            begin_ns, _ = buffer.time_range(self._trajectory.child, self._trajectory.moving)
            if last_ns < begin_ns:
                raise BagError(
                    f"{poses.name}: its stamps end at {_seconds(last_ns)}, but the odometry begins at"
                    f" {_seconds(begin_ns)}; if they count from a start, pass it as `start` or"
                    " --trajectory-start; if they are in another unit, name it, as in `timestamp_us`"
                )

    def _refuse_outside(self, buffer: BufferCore, poses: StampedPoses, none: str) -> None:
        """Refuse poses of which none is within the times of the odometry, whatever else they lack."""
        one, times_ns = self._trajectory, poses.times_ns[poses.times_ns > 0]
        with suppress(TransformException):  # there is no odometry
            begin_ns, end_ns = buffer.time_range(one.child, one.moving)
            if times_ns.size and not ((times_ns >= begin_ns) & (times_ns <= end_ns)).any():
                first, last, begin, end = (
                    _seconds(int(ns)) for ns in (times_ns.min(), times_ns.max(), begin_ns, end_ns)
                )
                raise BagError(
                    f"{poses.name}: {none}their stamps are from {first} to {last}, but"
                    f" {printable(one.moving)} in {printable(one.child)} is known from {begin} to {end}"
                )

    def _refuse(self, buffer: BufferCore, poses: StampedPoses, none: str, error: Exception) -> NoReturn:
        """Raise the BagError for an error of ``correct``, with the place of the pose that it is about."""
        one = self._trajectory
        place, reason = poses.name, str(error)
        is_missing = isinstance(error, ExtrapolationException)
        unset = np.flatnonzero(poses.times_ns == 0)
        if unset.size:
            place, reason = poses.place(unset[0]), "its stamp is 0, which means that it is not set"
        elif is_missing:
            found = buffer.lookup_matrices(one.child, one.moving, poses.times_ns, on_missing="nan")
            first = int(np.isnan(found[:, 0, 0]).argmax())
            place = poses.place(first)
            try:
                buffer.lookup_transform_core(one.child, one.moving, int(poses.times_ns[first]))
            except TransformException as exact:  # without an index
                reason = str(exact)
        elif "times[" in reason:
            reason += " (times[0] is that of its first pose)"
        advice = ""
        if one.on_missing == "raise" and (unset.size or is_missing):
            advice = '; on_missing="skip" leaves such poses out'
        raise BagError(f"{place}: {none}{reason}{advice}") from error


def _of_arrays(poses: Any, times_ns: Any) -> StampedPoses:
    """:raises TypeError, ValueError: they are not N poses and times."""
    pair = poses if isinstance(poses, tuple) else to_arrays(poses)
    to_matrix(pair)  # checks the shapes
    translations, rotations = (np.array(part, float) for part in pair)
    if translations.ndim != 2 or not len(translations):
        raise ValueError(
            f"path: expected N poses, got arrays of shapes {translations.shape} and {rotations.shape}"
        )
    if times_ns.shape != (count := len(translations),):
        raise ValueError(f"expected a stamp for each of the {count} poses, got {len(times_ns)} in `times`")
    found = StampedPoses("the trajectory", "pose", np.arange(1, count + 1), times_ns, translations, rotations)
    found.check()
    return found


def _name_of(argument: str, path: Any) -> str:
    return printable(os.fspath(path)) if isinstance(path, str | PathLike) else f"`{argument}`"


def _of_equal_stamps(poses: StampedPoses, *, skips: bool) -> tuple[int, int]:
    """
    Count the poses that repeat an earlier one with the same stamp, and those that others with the same stamp
    differ from.

    :param skips: count the latter. Otherwise, they are a BagError.
    """
    rows = np.arange(len(poses))
    own = np.where(poses.times_ns == 0, -1 - rows, poses.times_ns)  # no stamp is not an equal one
    _, first, group = np.unique(own, return_index=True, return_inverse=True)
    matrices = to_matrix((poses.translations, poses.rotations))
    differs = np.abs(matrices - matrices[first[group]]).max(axis=(1, 2)) > SAME
    if differs.any() and not skips:
        other = int(differs.argmax())
        one = int(first[group[other]])
        distance = np.linalg.norm(poses.translations[other] - poses.translations[one])
        cosine = (np.trace(matrices[one, :3, :3].T @ matrices[other, :3, :3]) - 1.0) / 2.0
        angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        raise BagError(
            f"{poses.place(one, other)}: both stamps are {_seconds(int(poses.times_ns[one]))}, but the poses"
            f' are {distance:.3g} m and {angle:.3g} degrees apart; on_missing="skip" leaves them out'
        )
    is_different = np.isin(group, group[differs])
    return int((~is_different & (first[group] != rows)).sum()), int(is_different.sum())


def _seconds(time_ns: int) -> str:
    return f"{time_ns // S}.{time_ns % S:09d} s"
