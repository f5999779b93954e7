# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correct a recording by a trajectory, the poses at keyframes that a SLAM has exported or published."""

import os
from argparse import ArgumentTypeError
from contextlib import suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tf2_py import BufferCore, ExtrapolationException, TransformException, stored_name
from tf2_py.printable import printable
from tf2_ros.correction import correct
from tf2_ros.numpy import to_nanoseconds
from tf2_ros_tools.common.options import nanoseconds
from tf2_ros_tools.common.output import counted
from tf2_ros_tools.recordings.bag_reader import BagError, Recorded, listed, typestore

# The stamps of N poses in ns, and the poses in one of the forms that `correct` takes.
Stamped: TypeAlias = tuple[NDArray[np.int64], Any]

# How far a stamp may be from the one that was rounded: many programs write microseconds.
ROUNDED_NS = 1_000
PATH = "nav_msgs/msg/Path"


@dataclass(frozen=True)
class Trajectory:
    """
    Poses of a frame at keyframes, by which :func:`tf2_ros_tools.bag.load` corrects a recording.

    :param path: one of

        - a file in the format of the TUM RGB-D benchmark, which evo and most SLAMs write: lines of stamp
          (seconds) x y z (meters) qx qy qz qw, with spaces or commas in between, in any order. Empty lines,
          those that begin with ``#``, and a first line of names have no pose;
        - with ``times``, a file in the format of KITTI: lines of 12 numbers, the first three rows of a
          homogeneous matrix, in meters;
        - a topic of the recording of type ``nav_msgs/Path``: a str that begins with ``/``, if no file has
          this name. Its last message counts, whatever ``start`` and ``end`` are.

    :param parent: the frame in which the poses are given, such as ``map``.
    :param child: the frame whose transform from ``parent`` is replaced, such as ``odom``.
    :param moving: the frame whose poses are given, such as ``base_link``.
    :param before: see :func:`tf2_ros.correction.correct`.
    :param after: see the same function.
    :param on_missing: see the same function. At least one pose must be used.
    :param times: a file with a line for each pose in ``path``, its stamp in seconds on the clock of the
        recording; only for KITTI.
    :raises TypeError: the name of a frame is not a str.

    A pose up to 1 µs from the first or the last odometry is used there, because its stamp may be rounded.
    """

    path: str | PathLike[str]
    parent: str
    child: str
    moving: str
    before: Literal["keep", "hold"] = "keep"
    after: Literal["keep", "hold"] = "hold"
    on_missing: Literal["raise", "skip"] = "raise"
    times: str | PathLike[str] | None = None

    def __post_init__(self) -> None:
        for name in ("parent", "child", "moving"):
            if not isinstance(frame := getattr(self, name), str):
                raise TypeError(f"{name}: expected a str, the name of a frame, got {frame!r}")


class Keyframes:
    """
    The poses of a trajectory: what its files contain now, or the topic of a recording.

    ``child`` is the frame whose transforms they replace, as buffers store its name.

    :raises TypeError: it is not a ``Trajectory``.
    :raises FileNotFoundError, OSError: a file cannot be read.
    :raises BagError: a file does not have the format.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        if not isinstance(trajectory, Trajectory):
            raise TypeError(f"trajectory: expected a Trajectory, got {type(trajectory).__name__}")
        self._trajectory, path, times = trajectory, trajectory.path, trajectory.times
        self.child = stored_name(trajectory.child)
        self._name = printable(os.fspath(path))
        self._in_files: Stamped | None = None
        if times is None and isinstance(path, str) and path.startswith("/") and not os.path.exists(path):
            return  # it is a topic
        content = Path(path).read_bytes()
        if times is None:
            self._in_files = _tum(self._name, content)
        else:
            stamps = Path(times).read_bytes()
            self._in_files = _kitti(self._name, content, printable(os.fspath(times)), stamps)

    def correct(self, buffer: BufferCore, recorded: Recorded) -> list[str]:
        """
        Correct the buffer of a recording.

        :return: a sentence if poses are left out.
        :raises BagError: a pose cannot be used, or none can; or the frames are wrong.
        """
        one, (times_ns, poses) = self._trajectory, self._poses(buffer, recorded)
        what = buffer, one.parent, one.child, one.moving, times_ns, poses
        how: dict[str, Any] = {"before": one.before, "after": one.after}
        none = ""
        try:
            used = correct(*what, **how, on_missing=one.on_missing)
            if not used:
                none = "none of its poses can be used: "
                correct(*what, **how)  # says why
        except (TransformException, ValueError, OverflowError) as error:
            may_skip = one.on_missing == "raise" and isinstance(error, ExtrapolationException)
            advice = '; on_missing="skip" leaves such poses out' * may_skip
            first = " (times[0] is that of its first pose)" * ("times[" in str(error))
            raise BagError(f"{self._name}: {none}{error}{first}{advice}") from error
        different = len(np.unique(times_ns))  # equal poses at one stamp are one
        left_out, count = different - used, counted(different, "pose")
        if not left_out:
            return []
        are = "is" if left_out == 1 else "are"
        why = f"{printable(one.moving)} in {printable(one.child)} is not known then or no longer kept"
        why += " or the stamp is 0" * bool((times_ns == 0).any())
        why += " or others with the same stamp differ" * (different < len(times_ns))
        return [f"{left_out} of the {count} in {self._name} {are} left out, because {why}"]

    def _poses(self, buffer: BufferCore, recorded: Recorded) -> Stamped:
        """Get the poses, with the stamps that were rounded at the ends of the odometry."""
        times_ns, poses = self._in_files or _of_topic(recorded, self._name, self._trajectory.parent)
        with suppress(TransformException):  # there is no odometry
            for end_ns in buffer.time_range(self._trajectory.child, self._trajectory.moving):
                times_ns = np.where(abs(times_ns - end_ns) <= ROUNDED_NS, end_ns, times_ns)
        return times_ns, poses


def _of_topic(recorded: Recorded, topic: str, parent: str) -> Stamped:
    """Read the last path on a topic."""
    name = f"{printable(recorded.path)}, topic {printable(topic)}"
    paths = [one.name for one in recorded.topics.values() if one.msgtype == PATH]
    if topic not in paths:
        raise BagError(
            f"{printable(topic)} is neither a file nor a topic of {printable(recorded.path)} with {PATH};"
            f" its topics with this type: {listed(paths)}"
        )
    last = recorded.last(topic)
    if last is None:
        raise BagError(f"{name}: it has no messages")
    log_ns, raw = last
    try:
        path: Any = typestore().deserialize_cdr(raw, PATH)
    except Exception as error:  # rosbags defines an error class only for some kinds of damage
        recorded.malformed(topic, log_ns, error)
    frame = path.header.frame_id
    if frame.removeprefix("/") != parent.removeprefix("/"):
        raise BagError(f"{name}: expected poses in {parent!r}, got poses in {frame!r}")
    if not path.poses:
        raise BagError(f"{name}: its last message has no poses")
    return to_nanoseconds([pose.header.stamp for pose in path.poses]), path.poses


# Read files.


STAMP = "a stamp in seconds"
TUM = f"8 numbers, {STAMP} and x y z qx qy qz qw"
KITTI = "12 numbers, the first three rows of a matrix"


def _tum(name: str, content: bytes) -> Stamped:
    times_ns, numbers = _read(name, content, TUM, 1, 7)
    return times_ns, (numbers[:, :3], numbers[:, 3:])


def _kitti(name: str, content: bytes, times: str, stamps: bytes) -> Stamped:
    _, rows = _read(name, content, KITTI, 0, 12)
    times_ns, _ = _read(times, stamps, f"one number, {STAMP}", 1, 0)
    if len(times_ns) != len(rows):
        raise BagError(
            f"expected a stamp for each of the {len(rows)} poses in {name}, got {len(times_ns)} in {times}"
        )
    matrices = np.zeros((len(rows), 4, 4))
    matrices[:, :3] = rows.reshape(-1, 3, 4)
    matrices[:, 3, 3] = 1.0
    return times_ns, matrices


def _read(
    name: str, content: bytes, expected: str, stamps: int, others: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Read a table whose lines begin with stamps; shapes (N,), if there is one in each, and (N, others)."""
    times_ns: list[int] = []
    rows: list[list[float]] = []
    for number, line in enumerate(content.decode("utf-8-sig", "replace").splitlines(), 1):
        text = line.strip()
        fields = text.replace(",", " ").split()
        is_heading = not rows and not any(map(str.isdigit, text))
        if not fields or text.startswith("#") or is_heading:
            continue
        try:
            times_ns += map(nanoseconds, fields[:stamps])
            rows.append([*map(float, fields[stamps:])])
        except (ValueError, ArgumentTypeError):
            rows.append([])
        if len(rows[-1]) != others or len(fields) != stamps + others or not np.isfinite(rows[-1]).all():
            advice = "; KITTI's poses need `times` or `--trajectory-times`" * (len(fields) == 12)
            raise BagError(f"{name}, line {number}: expected {expected}, got {printable(text)!r}{advice}")
    if not rows:
        raise BagError(f"{name}: expected lines of {expected}; there are none")
    return np.array(times_ns, np.int64), np.array(rows)
