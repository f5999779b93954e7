# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correct the past of a buffer with poses at keyframes, as SLAM exports them after a loop closure."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from tf2_py import (
    BufferCore,
    FrameInfo,
    InvalidArgumentException,
    LookupException,
    TransformException,
    stored_name,
)
from tf2_py._internal import as_times_ns, is_invalid_name, seconds
from tf2_py.typing import TimesLike
from tf2_ros._arguments import kind_of
from tf2_ros.numpy import Array, Message, Pair, to_arrays, to_matrix
from tf2_ros.serialization import serialize_arrays

__all__ = ["correct"]

AUTHORITY = "tf2_ros.correction"
LATEST_NS = 2**31 * 10**9 - 1  # the latest stamp, at which the time range of static frames ends
NAT = -(2**63)  # a time that is missing, as of numpy.datetime64
SAME = 1e-9  # two poses are one if no number of their matrices differs by more: in meters, and of rotations
# Transforms that arrive between reading and writing may make a sample too old. Then everything is tried again
# without the oldest part of the cache time: first this fraction, then twice as much each time.
FRACTION = 100
TRIES = 7


class _Edge(NamedTuple):
    """The transform that is corrected, and the frame whose poses are known."""

    buffer: BufferCore
    parent: str
    child: str
    moving: str


def correct(
    buffer: BufferCore,
    parent: str,
    child: str,
    moving: str,
    times: TimesLike,
    poses: Iterable[Message] | Pair | npt.NDArray[Any],
    *,
    before: Literal["keep", "hold"] = "keep",
    after: Literal["keep", "hold"] = "hold",
    on_missing: Literal["raise", "skip"] = "raise",
) -> int:
    """
    Replace past samples of one transform, so that a frame follows the poses that SLAM computed.

    :param buffer: a :class:`tf2_ros.Buffer` or :class:`tf2_py.BufferCore`.
    :param parent: the frame in which the poses are given, such as ``map``.
    :param child: the frame whose transform from ``parent`` is replaced, such as ``odom``.
    :param moving: the frame whose poses are given, such as ``base_link``; at or below ``child``.
    :param times: N times of keyframes above 0, in any order, as for ``Buffer.lookup_transforms``. Equal ones
        whose poses agree within 1e-9 are one keyframe.
    :param poses: the pose of ``moving`` in ``parent`` at each of these times: N messages, a tuple
        ``(translations, rotations)``, or matrices of shape (N, 4, 4), as for
        :func:`tf2_ros.numpy.to_arrays` and :func:`tf2_ros.numpy.to_matrix`. In meters. The frames of stamped
        messages are ``parent`` or empty.
    :param before: what happens to the time before the first keyframe. ``"keep"``: its samples remain.
        ``"hold"``: it gets the correction of the first keyframe, back to the oldest data.
    :param after: the same after the last keyframe, on to the newest data. Transforms that arrive later are
        not corrected.
    :param on_missing: what happens to a keyframe at which ``moving`` in ``child`` is not known, or which is
        older than the buffer would keep, and to keyframes with equal times but different poses. ``"raise"``:
        an exception. ``"skip"``: they are not used.
    :return: how many keyframes were used; equal ones count once. If it is 0, nothing has changed.
    :raises TypeError: ``buffer`` is not a buffer, or the type of an argument is wrong.
    :raises ValueError: a shape, a number or an option is wrong; a pose is given in another frame than
        ``parent``; ``moving`` is not at or below ``child`` at a keyframe, or ``parent`` is; ``child`` is
        static; a keyframe is at or before time 0, or older than ``cache_time`` allows; keyframes at one time
        have different poses; or the buffer refuses the samples.
    :raises OverflowError: a time does not fit into the stamp of a message.
    :raises InvalidArgumentException: a name is empty, or begins with more than one ``/``.
    :raises TransformException: ``moving`` in ``child`` is not known at a keyframe; the text has its index.

    Each keyframe becomes a sample of ``child`` in ``parent``: its pose, multiplied by the inverse of the pose
    of ``moving`` in ``child`` at that time. Between keyframes, this correction is interpolated, not the pose,
    so ``moving`` keeps the details that the odometry knows. Other threads see all of it or nothing.

    >>> from geometry_msgs.msg import TransformStamped
    >>> from tf2_ros import Buffer
    >>> from tf2_ros.correction import correct
    >>> robot = TransformStamped(child_frame_id="base_link")
    >>> robot.header.frame_id = "odom"
    >>> buffer = Buffer()
    >>> for second in (1, 2, 3):
    ...     robot.header.stamp.sec, robot.transform.translation.x = second, 1.1 * second  # it slips
    ...     buffer.set_transform(robot, "wheels")
    >>> keyframes = [[1.0, 0.0, 0.0], [3.0, 0.0, 0.0]], [[0.0, 0.0, 0.0, 1.0]] * 2
    >>> correct(buffer, "map", "odom", "base_link", [1_000_000_000, 3_000_000_000], keyframes)
    2
    >>> round(buffer.lookup_transform("map", "base_link", 2_000_000_000).transform.translation.x, 9)
    2.0
    """
    if not issubclass(type(buffer), BufferCore):  # isinstance believes a Mock(spec=Buffer)
        raise TypeError(f"buffer: expected a Buffer or BufferCore, got {kind_of(buffer)}")
    _check_option("before", before, ("keep", "hold"))
    _check_option("after", after, ("keep", "hold"))
    _check_option("on_missing", on_missing, ("raise", "skip"))
    for name, frame in (("parent", parent), ("child", child), ("moving", moving)):
        if not isinstance(frame, str):
            raise TypeError(f"{name}: expected a str, the name of a frame, got {kind_of(frame)}")
        if is_invalid_name(stored_name(frame)):
            raise InvalidArgumentException(f"{name}: expected the name of a frame, got {frame!r}")
    edge = _Edge(buffer, *map(stored_name, (parent, child, moving)))
    times_ns = as_times_ns(times)
    bad = np.flatnonzero((times_ns != NAT) & ((times_ns < 0) | (times_ns > LATEST_NS)))
    if bad.size:
        time_ns = int(times_ns[bad[0]])
        if time_ns > LATEST_NS:
            raise OverflowError(
                f"times[{bad[0]}]: the time {seconds(time_ns)} s does not fit into the stamp of a message"
            )
        raise ValueError(f"times[{bad[0]}]: expected a time above 0, got {seconds(time_ns)} s")
    matrices = _matrices(poses, len(times_ns), edge.parent)
    if on_missing == "raise" and (times_ns == 0).any():
        bad = np.flatnonzero(times_ns == 0)
        raise ValueError(f"times[{bad[0]}]: expected a time above 0, which means the latest in lookups")
    is_wanted = _first_of_equal(times_ns, matrices, skips=on_missing == "skip")
    for tried in range(TRIES):
        margin_ns = (1 << tried >> 1) * (buffer.cache_time_ns // FRACTION)
        used, stamps_ns, corrections = _samples(
            edge, times_ns, matrices, is_wanted, before, after, on_missing == "skip", margin_ns
        )
        frames = [(edge.parent, edge.child)] * len(stamps_ns)
        data = serialize_arrays(frames, stamps_ns, np.hstack(to_arrays(corrections)))
        # Other threads may insert meanwhile, so that some samples are too old. The last try logs them.
        if BufferCore._tf2_replace(buffer, data, AUTHORITY, tried + 1 == TRIES) == len(frames):
            return used
    raise ValueError(
        f"the buffer refused the samples of {edge.child!r} in {edge.parent!r}; its log line has the reason"
    )


def _check_option(name: str, given: str, accepted: tuple[str, str]) -> None:
    if given not in accepted:
        raise ValueError(f"{name}: expected {accepted[0]!r} or {accepted[1]!r}, got {given!r}")


def _matrices(poses: Any, count: int, parent: str) -> Array:
    poses = poses if isinstance(poses, tuple | np.ndarray) else [*poses]
    for i, one in enumerate(() if isinstance(poses, tuple) else poses):
        frame = getattr(getattr(one, "header", None), "frame_id", "")
        if stored_name(frame) not in ("", parent):
            raise ValueError(f"poses[{i}]: expected a pose in {parent!r}, got one in {frame!r}")
    matrices = to_matrix(poses if isinstance(poses, tuple) else to_arrays(poses))
    if matrices.shape != (count, 4, 4):
        given = matrices.shape[:-2]
        raise ValueError(f"poses: expected one for each of the {count} times, got the shape {given} of poses")
    bad = np.flatnonzero(~np.isfinite(matrices).all(axis=(1, 2)))
    if bad.size:
        raise ValueError(f"poses[{bad[0]}]: expected finite numbers")
    return matrices


def _first_of_equal(times_ns: npt.NDArray[np.int64], matrices: Array, skips: bool) -> npt.NDArray[np.bool_]:
    """
    Whether a keyframe has a time, and is the first one at that time.

    :param skips: if the poses at a time differ, leave out all of them. Otherwise, raise.
    """
    known = np.flatnonzero(times_ns > 0)
    _, first, group = np.unique(times_ns[known], return_index=True, return_inverse=True)
    first_of_each = known[first[group]]
    difference = np.abs(matrices[known] - matrices[first_of_each]).max(axis=(1, 2), initial=0.0)
    bad = np.flatnonzero(difference > SAME)
    if bad.size and not skips:
        one, two = first_of_each[bad[0]], known[bad[0]]
        raise ValueError(
            f"times[{one}] and times[{two}] are both {seconds(int(times_ns[one]))} s, but their poses are "
            f"{_apart(matrices[one], matrices[two])} apart"
        )
    is_first = np.zeros(len(times_ns), np.bool_)
    is_first[known[np.delete(first, group[bad])]] = True
    return is_first


def _apart(one: Array, two: Array) -> str:
    """The distance and the angle between two poses."""
    distance = np.linalg.norm(two[:3, 3] - one[:3, 3])
    # Of small angles, the cosine says little.
    angle = 2.0 * np.arcsin(min(np.linalg.norm(two[:3, :3] - one[:3, :3]) / np.sqrt(8.0), 1.0))
    return f"{distance:.3g} m and {np.degrees(angle):.3g} degrees"


def _samples(
    edge: _Edge,
    times_ns: npt.NDArray[np.int64],
    matrices: Array,
    is_wanted: npt.NDArray[np.bool_],
    before: str,
    after: str,
    skips: bool,
    margin_ns: int,
) -> tuple[int, list[int], Array]:
    """How many keyframes are used, and the stamps and matrices that are to be inserted."""
    buffer, _, child, moving = edge
    on_missing: Literal["nan", "raise"] = "nan" if skips else "raise"
    inverses = BufferCore.lookup_matrices(buffer, moving, child, times_ns, on_missing=on_missing)
    is_used = ~np.isnan(inverses[:, 0, 0]) & is_wanted
    if not is_used.any():
        return 0, [], inverses[:0]
    info = _checked_child(edge, times_ns, np.flatnonzero(is_used))
    oldest_ns, newest_ns = _range_of_data(edge, info, times_ns[is_used], after)
    kept_from_ns = newest_ns - buffer.cache_time_ns
    begin_ns = kept_from_ns + margin_ns
    old = np.flatnonzero(is_used & (times_ns < (begin_ns if skips else kept_from_ns)))
    if old.size and not skips:
        raise ValueError(
            f"times[{old[0]}]: {seconds(int(times_ns[old[0]]))} s is more than cache_time, "
            f"{seconds(buffer.cache_time_ns)} s, before {seconds(newest_ns)} s, the newest stamp of {child!r}"
        )
    is_used[old] = False
    index = np.flatnonzero(is_used)
    index = index[np.argsort(times_ns[index])]
    if len(index) == 0:
        return 0, [], inverses[:0]
    stamps_ns = times_ns[index].tolist()
    corrections = [*(matrices[index] @ inverses[index])]
    if before == "hold" and max(oldest_ns, begin_ns) < stamps_ns[0]:
        corrections.insert(0, corrections[0])
        stamps_ns.insert(0, max(oldest_ns, begin_ns))
    if after == "hold" and newest_ns > stamps_ns[-1]:
        stamps_ns.append(newest_ns)
        corrections.append(corrections[-1])
    return len(index), stamps_ns, np.array(corrections)


def _checked_child(edge: _Edge, times_ns: npt.NDArray[np.int64], index: npt.NDArray[np.intp]) -> FrameInfo:
    """The child; raises unless one climbs, at each of these keyframes, from the moving frame to it alone."""
    buffer, parent, child, moving = edge
    frames = BufferCore.frames(buffer)
    info = frames.get(child)
    if info is None:
        raise LookupException(f"child: {child!r} does not exist")
    if info.static:
        advice = ""
        if info.parent is not None and frames[info.parent].parent is None:
            advice = (
                f"; to correct it together with its parent, pass {info.parent!r} as child and a new frame, "
                "such as 'world', as parent"
            )
        raise ValueError(f"child: {child!r} is static, so it has no past that could be corrected{advice}")
    for i in index.tolist():
        time_ns = int(times_ns[i])
        # Later arrivals may have pruned what is needed, also between two questions; then there is no parent.
        with suppress(TransformException):
            path = BufferCore.path(buffer, moving, child, time_ns)
            if parent in path or BufferCore.parent(buffer, child, time_ns) in path[1:2]:
                raise ValueError(
                    f"moving: expected a frame at or below {child!r}, and not over {parent!r}, got "
                    f"{moving!r}; the path between them at times[{i}] is {' → '.join(path)}"
                )
        with suppress(TransformException):  # mostly, nothing connects them yet
            path = BufferCore.path(buffer, parent, child, time_ns)
            if len(path) == 1 or BufferCore.parent(buffer, path[1], time_ns) == child:
                raise ValueError(f"parent: expected a frame that is not below {child!r}, got {parent!r}")
    return info


def _range_of_data(
    edge: _Edge, info: FrameInfo, times_ns: npt.NDArray[np.int64], after: str
) -> tuple[int, int]:
    """The oldest stamp to which a correction may be held, and the newest that the child will have."""
    buffer, _, child, moving = edge
    first_ns, last_ns = int(times_ns.min()), int(times_ns.max())
    if info.oldest_ns is not None and info.newest_ns is not None:
        first_ns, last_ns = min(first_ns, info.oldest_ns), max(last_ns, info.newest_ns)
    with suppress(TransformException):  # the data of one frame begins after that of another one ends
        begin_ns, end_ns = BufferCore.time_range(buffer, child, moving)
        if end_ns != LATEST_NS:
            first_ns = min(first_ns, begin_ns)
            last_ns = max(last_ns, end_ns) if after == "hold" else last_ns
    return first_ns, last_ns
