"""Correct a recording by a trajectory, the poses at keyframes that a SLAM has written to a file."""

import hashlib
import os
from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from decimal import Decimal, DecimalException
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tf2_py import BufferCore, TransformException
from tf2_py.printable import printable
from tf2_ros.correction import correct
from tf2_ros_tools.common.output import counted
from tf2_ros_tools.recordings.bag_reader import BagError

DIGITS = 9  # of nanoseconds after the decimal point
NUMBERS = "a stamp in seconds and x y z qx qy qz qw"


@dataclass(frozen=True)
class Trajectory:
    """
    Poses of a frame at keyframes, by which :func:`tf2_ros_tools.bag.load` corrects a recording.

    :param path: a file in the format of the TUM RGB-D benchmark, which evo and most SLAMs write: lines of
        stamp (seconds) x y z (meters) qx qy qz qw. Empty lines and those that begin with ``#`` have no pose.
    :param parent: the frame in which the poses are given, such as ``map``.
    :param child: the frame whose transform from ``parent`` is replaced, such as ``odom``.
    :param moving: the frame whose poses are given, such as ``base_link``.
    :param before: see :func:`tf2_ros.correction.correct`.
    :param after: see the same function.
    :param on_missing: see the same function.
    """

    path: str | PathLike[str]
    parent: str
    child: str
    moving: str
    before: Literal["keep", "hold"] = "keep"
    after: Literal["keep", "hold"] = "hold"
    on_missing: Literal["raise", "skip"] = "raise"


class Keyframes:
    """
    What the file of a trajectory contains now.

    :raises TypeError: it is not a ``Trajectory``.
    :raises FileNotFoundError, OSError: the file cannot be read.
    :raises BagError: a line is not a pose.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        if not isinstance(trajectory, Trajectory):
            raise TypeError(f"trajectory: expected a Trajectory, got {type(trajectory).__name__}")
        content = Path(trajectory.path).read_bytes()
        self._trajectory, self._name = trajectory, printable(os.fspath(trajectory.path))
        self._times_ns, self._poses = _read_tum(content, self._name)
        # What a buffer that is corrected by it depends on; JSON can hold it.
        self.key: list[Any] = [*astuple(replace(trajectory, path="")), hashlib.sha256(content).hexdigest()]

    def correct(self, buffer: BufferCore) -> Iterator[str]:
        """
        Correct a buffer, and yield a sentence if keyframes are left out.

        :raises BagError: a keyframe cannot be used, or the frames are wrong.
        """
        one = self._trajectory
        try:
            used = correct(
                buffer,
                one.parent,
                one.child,
                one.moving,
                self._times_ns,
                (self._poses[:, :3], self._poses[:, 3:]),
                before=one.before,
                after=one.after,
                on_missing=one.on_missing,
            )
        except (TransformException, ValueError) as error:
            raise BagError(f"{self._name}: {error} (times[0] is that of its first pose)") from error
        left_out, count = len(self._times_ns) - used, counted(len(self._times_ns), "pose")
        if left_out:
            are = "is" if left_out == 1 else "are"
            why = f"{printable(one.moving)} in {printable(one.child)} is not known then or no longer kept"
            yield f"{left_out} of the {count} in {self._name} {are} left out, because {why}"


def _read_tum(content: bytes, name: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Read the stamps, shape (N,), and the poses, shape (N, 7), of a file in the format of TUM."""
    times_ns: list[int] = []
    poses: list[list[float]] = []
    for number, line in enumerate(content.decode("utf-8-sig", "replace").splitlines(), 1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            stamp, *pose = fields
            times_ns.append(_nanoseconds(stamp))
            poses.append([*map(float, pose)])
        except (ValueError, DecimalException):
            poses.append([])
        if len(poses[-1]) != 7 or not np.isfinite(poses[-1]).all():
            given = printable(line.strip())
            raise BagError(f"{name}, line {number}: expected 8 numbers, {NUMBERS}, got {given!r}")
    if not poses:
        raise BagError(f"{name}: expected lines of 8 numbers, {NUMBERS}; there are none")
    return np.array(times_ns, np.int64), np.array(poses)


def _nanoseconds(seconds: str) -> int:
    # A float cannot represent all digits.
    nanoseconds = Decimal(seconds).scaleb(DIGITS)
    if not 0 <= nanoseconds < 1 << 63:  # before `int`, which may need a million digits
        raise ValueError
    return int(nanoseconds.to_integral_value())
