# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Deskew a cloud: transform each point from where the sensor was when it measured that point."""

import contextlib
import time
import warnings
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2

from tf2_py._internal import (
    MalformedObjectError,
    as_times_ns,
    duration_ns,
    errors,
    frame_name,
    policy_of,
    time_ns,
)
from tf2_py.printable import printable
from tf2_py.typing import DurationLike, LookupPolicy, TimeLike, TimesLike, Unpack
from tf2_ros import BufferCore, FrameInfo, LookupException, TransformException
from tf2_ros._arguments import kind_of
from tf2_ros._frame_prefix import frame_of
from tf2_sensor_msgs._cloud import Points
from tf2_sensor_msgs._time_field import KNOWN, NAMES, S, TimeField, Unit, find_time_field

# A ROS stamp holds no more seconds than these. So a larger number in a `timestamp` is nanoseconds.
MOST_SECONDS = 2.0**31
# In a longer sweep, or one of over an hour with a unit given, some times are nonsense or the unit is wrong:
# the pose of each point is looked up. Times that are all an hour from the stamp are taken for a wrong unit.
LONG_NS, FAR_NS = 3 * S, 3600 * S
# A sweep of many points that is shorter is reported, as the unit may be wrong, or the field not set.
SHORT_NS, MANY_POINTS = S // 1000, 1000
# No time is farther from the stamp, or from 1970.
FARTHEST_NS = 2.0**62
NOT_LATEST_NS = 1  # looked up for 0, which would mean the latest time
NO_TIME = np.iinfo(np.int64).min  # what read_times writes for a point that has none; NaT, as an integer
# Between two knots, poses change steadily. Then a point is off by at most `TURN` times its distance and
# `MOVE` meters: a tenth less than what is promised, for rounding.
TURN, MOVE = 9e-7, 9e-6
# With more knots than one for this many points, lookups for all points cost no more.
POINTS_PER_KNOT = 8


class Poses(NamedTuple):
    """Poses between which the points move steadily, as ``Points.moved`` takes them."""

    knots: NDArray[np.int64] | None
    matrices: NDArray[np.float64]


class Motion(NamedTuple):
    """The arguments of the lookups of one cloud."""

    buffer: BufferCore
    target_frame: str
    source_frame: str
    fixed: dict[str, Any]  # fixed_frame and target_time, or nothing
    policy: LookupPolicy

    @property
    def frames(self) -> tuple[str, str]:
        return self.target_frame, self.source_frame


def deskew(
    cloud: PointCloud2,
    buffer: BufferCore,
    target_frame: str,
    fixed_frame: str | None = None,
    target_time: TimeLike | None = None,
    *,
    times: TimesLike | None = None,
    time_unit: DurationLike | None = None,
    timeout: DurationLike = 0,
    on_missing: Literal["raise", "nan"] = "raise",
    prefix: str = "",
    **policy: Unpack[LookupPolicy],
) -> PointCloud2:
    """
    Transform each point of a cloud from where the sensor was when it measured that point.

    :param cloud: the points, in meters, and the time of each in one of these fields, which the drivers of
        Velodyne, Ouster, Livox and Hesai write: ``time`` (float32 or float64: seconds after the cloud's
        stamp, possibly negative), ``t`` or ``offset_time`` (uint32: nanoseconds after the stamp; numbers from
        2^31 on stand for negative ones), ``timestamp`` (float64: seconds since 1970; numbers from 2^31 on
        are nanoseconds).
    :param buffer: the transforms.
    :param target_frame: the frame to transform the points into. Without ``fixed_frame``, the sensor must move
        in it, as in ``odom``.
    :param fixed_frame: a frame that does not move, such as ``odom``. Pass it if ``target_frame`` moves, as
        the robot's and the cloud's own frame do: the points are transformed into the target frame at
        ``target_time``.
    :param target_time: only with ``fixed_frame``. None: the stamp of the cloud. 0: the latest common time of
        both frames, or the stamp of the cloud if only static transforms connect them.
    :param times: the time of each point, row by row, as for ``buffer.lookup_transforms``, instead of a field;
        0 is the time 0, not the latest.
    :param time_unit: the unit of the numbers in the field, if it is not the one above: seconds or a duration,
        for example 1e-6 for microseconds. For fractions from 0 to 1, pass the duration of a sweep. The unit
        must be a whole number of nanoseconds. With it, ``time``, ``t`` and ``offset_time`` may have any type,
        and a sweep any length.
    :param timeout: how long to wait for the transform of the last point; only for a ``tf2_ros.Buffer``. Times
        over 3 s after the stamp, or over an hour with ``time_unit`` or ``times``, are not waited for.
    :param on_missing: ``'raise'`` raises the error of the first point without a transform, with its index;
        ``'nan'`` sets the coordinates of such points, and of those with an invalid time, to NaN, so they must
        be floats.
    :param prefix: put before the frame of the cloud, as in ``buffer.transform``.
    :param policy: options such as ``tolerance``, see :class:`tf2_py.typing.LookupPolicy`, but not
        ``max_age``, because points have times.
    :return: a new PointCloud2 in ``target_frame``, with the stamp of ``cloud``, or ``target_time``. The rest
        is copied, with one exception: with ``fixed_frame``, the field of times is set to the new stamp for
        every point, in the same unit.
    :raises TransformException: a point has no transform; see ``buffer.lookup_transform``.
    :raises OverflowError: ``target_time``, the stamp of the cloud, or the time of a point does not fit into
        the stamp of a message.
    :raises TypeError: an argument has the wrong type, or there is ``target_time`` without ``fixed_frame``, or
        ``time_unit`` with ``times``.
    :raises ValueError: no field has the times of the points; a time is not a number; the times need a
        ``time_unit``, because they may be fractions of a sweep, or are all over an hour from the stamp;
        ``on_missing`` is ``'nan'``, but coordinates are integers; the cloud is inconsistent, as in
        :func:`do_transform_cloud`; or the sensor does not move in ``fixed_frame`` (or, without one, in
        ``target_frame``), because that frame is the sensor's own or is fixed to it.

    A warning reports a sweep of 1,000 points or more within 1 ms, unless ``time_unit`` or ``times`` is given.

    Normals and viewpoints are transformed, too. Points with NaN coordinates need no time; in the result,
    their coordinates, normals and viewpoints are NaN. Integers are truncated, as in
    :func:`do_transform_cloud`.

    Poses are looked up at selected times and interpolated between them, so that the error of a point is at
    most 10 µm plus one millionth of its distance from the sensor, unless poses jump within microseconds. If
    this would not save time, the pose of each point is looked up.
    """
    if not issubclass(type(buffer), BufferCore):  # isinstance believes a Mock(spec=Buffer)
        raise TypeError(f"buffer: expected a tf2_ros.Buffer, got {type(buffer).__name__}")
    if not hasattr(cloud, "point_step"):
        raise MalformedObjectError(f"cloud: expected a sensor_msgs/PointCloud2, got {kind_of(cloud)}")
    points = Points(cloud)
    if on_missing not in ("raise", "nan"):
        raise ValueError(f"on_missing: expected 'raise' or 'nan', got {on_missing!r}")
    if on_missing == "nan":
        _require_floats(cloud)
    if target_time is not None and fixed_frame is None:
        raise TypeError("target_time needs a fixed_frame: a frame that does not move, such as odom")
    if times is not None and time_unit is not None:
        raise TypeError("pass times or time_unit, the unit of a field in the cloud, but not both")
    accepted = policy_of("deskew", True, **policy)
    if accepted is not None and accepted.judges_age:
        raise ValueError("max_age applies only to the latest transform: for points, use tolerance")
    source_frame = frame_of(cloud.header, prefix)
    stamp_ns = new_ns = time_ns(cloud.header.stamp, "header.stamp")
    until_ns = time.monotonic_ns() + _timeout_ns(buffer, timeout)
    fixed: dict[str, Any] = {}
    if fixed_frame is not None:
        frame_name(fixed_frame, "fixed_frame")
        new_ns = _target_ns(buffer, target_frame, fixed_frame, target_time, stamp_ns, until_ns)
        fixed = {"fixed_frame": fixed_frame, "target_time": new_ns or NOT_LATEST_NS}
    motion = Motion(buffer, target_frame, source_frame, fixed, policy)
    sweep = _read_sweep(points, stamp_ns, times, time_unit)
    if times is None and time_unit is None:
        _warn_if_short(sweep)
    if until_ns > time.monotonic_ns():
        _wait(motion, _last_needed(sweep, stamp_ns), until_ns)
    poses = _steady_poses(motion, sweep)
    # A sensor that ends where it began may not have moved at all.
    if len(points) and (poses is None or (poses.matrices[0] == poses.matrices[-1]).all()):
        _require_motion(buffer, source_frame, target_frame, fixed_frame)
    is_dense = cloud.is_dense
    if poses is None:
        poses = _exact_poses(motion, sweep, on_missing)
        is_dense = is_dense and not np.isnan(poses.matrices[:, 0, 0]).any()
    stored = None
    if sweep.field is not None and fixed:
        stored = new_ns / sweep.field.unit.ns if sweep.field.unit.is_absolute else 0.0
    return points.moved(new_ns, target_frame, is_dense, sweep.field, stored, sweep.times, *poses)


class Sweep(NamedTuple):
    """The times of a cloud's points: in a field, or given."""

    points: Points
    field: TimeField | None
    times: NDArray[np.int64] | None
    first: int  # ns, of the points with coordinates; later than `last` if there are none
    last: int
    is_complete: bool  # each point with coordinates has a time
    longest: int  # ns, of a sweep without nonsense

    @property
    def is_long(self) -> bool:
        return self.last - self.first > self.longest


def _read_sweep(
    points: Points, stamp_ns: int, times: TimesLike | None, time_unit: DurationLike | None
) -> Sweep:
    if times is not None:
        given = as_times_ns(times, accepts_nat=True)
        needed = given.copy()
        bad, _ = points.read_times(None, needed)
        needed = needed[needed != NO_TIME]
        first, last = (int(needed.min()), int(needed.max())) if len(needed) else (0, -1)
        return Sweep(points, None, given, first, last, bad < 0, FAR_NS)
    field, is_guess = find_time_field(points.cloud, stamp_ns, time_unit), time_unit is None
    span = points.find_span(field, True)
    # The new time is stored even where no point has coordinates.
    voters = span if span.finite else points.find_span(field, False)
    if is_guess and field.unit.is_absolute and voters.large and 2 * voters.large >= voters.finite:
        field = field._replace(unit=Unit(1, True))
    longest = LONG_NS if is_guess else FAR_NS
    if not span.finite:
        return Sweep(points, field, None, 0, -1, span.points == 0, longest)
    if is_guess:
        _require_likely(field, span.lowest, span.highest, stamp_ns)
    if not -FARTHEST_NS < span.lowest * field.unit.ns <= span.highest * field.unit.ns < FARTHEST_NS:
        return Sweep(points, field, None, 0, -1, False, longest)
    first, last = field.time_ns(span.lowest), field.time_ns(span.highest)
    return Sweep(points, field, None, first, last, span.finite == span.points, longest)


def _warn_if_short(sweep: Sweep) -> None:
    size = len(sweep.points)
    if sweep.field is not None and size >= MANY_POINTS and 0 <= sweep.last - sweep.first < SHORT_NS:
        name, unit = sweep.field.name, sweep.field.unit.text
        seconds = (sweep.last - sweep.first) / S
        warnings.warn(
            f"deskew: the field {name} ({unit}) spans {seconds:g} s in {size} points, so hardly "
            "any motion is corrected: the field may be unset, the cloud already deskewed, "
            "or the unit wrong (pass time_unit)",
            stacklevel=3,
        )


def _require_likely(field: TimeField, lowest: float, highest: float, stamp_ns: int) -> None:
    """Refuse what may be fractions of a sweep, because few lidars need a second for one, or another clock."""
    if field.unit == KNOWN["time"][1] and 0.9 < highest - lowest <= 1:
        raise ValueError(
            f"{field.name} is from {lowest:.3g} to {highest:.3g}, which may be seconds or fractions of a "
            "sweep: pass time_unit=1, or the duration of a sweep, for example time_unit=0.1"
        )
    stamp = (stamp_ns - field.base_ns) / field.unit.ns
    after = (max(lowest - stamp, 0) or min(highest - stamp, 0)) * field.unit.ns / S
    if stamp_ns > 0 and abs(after) > FAR_NS / S:
        side = "before" if after < 0 else "after"
        raise ValueError(
            f"{field.name} is from {lowest:.10g} to {highest:.10g}, {abs(after):.6g} s {side} the cloud's "
            f"stamp if the numbers are {field.unit.text}. If that is right, pass "
            f"time_unit={field.unit.ns / S:g}; otherwise the right unit, or times"
        )


def _target_ns(
    buffer: Any,
    target_frame: str,
    fixed_frame: str,
    target_time: TimeLike | None,
    stamp_ns: int,
    until_ns: int,
) -> int:
    target_ns = stamp_ns if target_time is None else time_ns(target_time, "target_time")
    if target_time is not None and target_ns == 0:
        timeout = (until_ns - time.monotonic_ns()) / S
        if timeout > 0:
            with contextlib.suppress(TransformException):
                buffer.lookup_transform(target_frame, fixed_frame, 0, timeout)
        target_ns = buffer.get_latest_common_time(target_frame, fixed_frame).nanoseconds
    return int(target_ns or stamp_ns)


def _require_motion(
    buffer: BufferCore, source_frame: str, target_frame: str, fixed_frame: str | None
) -> None:
    """Refuse a frame that moves together with the sensor: nothing would be corrected."""
    frame = target_frame if fixed_frame is None else fixed_frame
    try:
        if frame != source_frame and buffer.get_latest_common_time(frame, source_frame).nanoseconds:
            return
    except TransformException:
        return  # the lookups say why
    frames = BufferCore.frames(buffer)
    try:
        body = _body(frames, frame, source_frame)
    except LookupException:
        if frame == source_frame:
            raise
        return  # nothing moves where static transforms form a loop
    moves_in = frames[body].parent if body in frames else None
    where = f"{'fixed_frame ' * bool(fixed_frame)}[{printable(frame)}], which moves with it"
    if frame == source_frame:
        where = "itself"
    elif moves_in is None or body != _body(frames, source_frame, frame):
        return
    wanted = f"{'another' if fixed_frame else 'a'} fixed_frame"
    wanted += " in which it moves" if moves_in is None else f", for example [{printable(moves_in)}]"
    raise ValueError(f"[{printable(source_frame)}] does not move in {where}: pass {wanted}")


def _body(frames: dict[str, FrameInfo], frame: str, other: str) -> str:
    """The topmost frame that a frame is fixed to."""
    passed: set[str] = set()
    while frame in frames and frames[frame].static and (parent := frames[frame].parent) is not None:
        if frame in passed:
            raise errors.loop(frame, other)
        passed.add(frame)
        frame = parent
    return frame


def _require_floats(cloud: PointCloud2) -> None:
    """Refuse coordinates that cannot be NaN."""
    datatypes = {field.name: field.datatype for field in reversed(list(cloud.fields))}
    for name in ("x", "y", "z"):
        kind = NAMES.get(datatypes.get(name, 0), "")
        if "int" in kind:
            raise ValueError(f"on_missing: 'nan' needs coordinates that are floats, but {name} is {kind}")


def _timeout_ns(buffer: BufferCore, timeout: DurationLike) -> int:
    timeout_ns = duration_ns(timeout, "timeout")
    if timeout_ns > 0 and not hasattr(buffer, "lookup_transform"):
        raise TypeError(f"timeout: only a tf2_ros.Buffer can wait, not a {type(buffer).__name__}")
    return timeout_ns


def _last_needed(sweep: Sweep, stamp_ns: int) -> int:
    """The last time to wait for, which is not one far in the future; -1: none."""
    if sweep.is_complete and not sweep.is_long:
        return sweep.last
    times, *_ = _all_times(sweep)
    latest = min(max(stamp_ns, sweep.first) + sweep.longest, np.iinfo(np.int64).max)
    return int(times.max(initial=-1, where=times <= latest))


def _all_times(sweep: Sweep) -> tuple[NDArray[np.int64], int, float]:
    """The time of each point, and the first point that lacks one; see ``Points.read_times``."""
    times = np.empty(len(sweep.points), np.int64) if sweep.times is None else sweep.times.copy()
    return times, *sweep.points.read_times(sweep.field, times)


def _wait(motion: Motion, last: int, until_ns: int) -> None:
    """Wait for the transform of the last point until a steady time; lookups report whether there is one."""
    timeout = (until_ns - time.monotonic_ns()) / S
    if timeout <= 0 or not 0 <= last < MOST_SECONDS * S:
        return
    buffer: Any = motion.buffer
    target, source, source_ns = motion.target_frame, motion.source_frame, last or NOT_LATEST_NS
    with contextlib.suppress(TransformException):
        if motion.fixed:
            fixed_frame, target_time = motion.fixed["fixed_frame"], motion.fixed["target_time"]
            buffer.lookup_transform_full(
                target, target_time, source, source_ns, fixed_frame, timeout, **motion.policy
            )
        else:
            buffer.lookup_transform(target, source, source_ns, timeout, **motion.policy)


def _steady_poses(motion: Motion, sweep: Sweep) -> Poses | None:
    """Poses from the first to the last time, with a steady motion between them; None: they would be many."""
    if not sweep.is_complete or sweep.is_long or sweep.last < sweep.first:
        return None
    first, last = sweep.first or NOT_LATEST_NS, sweep.last or NOT_LATEST_NS
    most = len(sweep.points) // POINTS_PER_KNOT
    found = BufferCore._poses_between(
        motion.buffer, *motion.frames, first, last, TURN, MOVE, most, **motion.fixed, **motion.policy
    )
    return None if found is None else Poses(*found)


def _require_target(motion: Motion) -> None:
    """Raise the error of the target time, if that is what fails at the time of every point."""
    target = motion.target_frame, motion.fixed["fixed_frame"], motion.fixed["target_time"]
    try:
        BufferCore.lookup_matrix(motion.buffer, *target, **motion.policy)
    except TransformException as error:
        raise type(error)(f"target_time: {error}") from None


def _exact_poses(motion: Motion, sweep: Sweep, on_missing: str) -> Poses:
    """One pose for each point; NaN for points without a time."""
    field = sweep.field
    times, bad, found = _all_times(sweep)
    if bad >= 0 and on_missing == "raise":
        if field is None:
            raise ValueError(f"times[{bad}]: expected a time, got NaT (the smallest int64)")
        where, text = f"points[{bad}]", field.unit.text
        raise ValueError(f"{where}: expected a time in the field {field.name}, in {text}, got {found:g}")
    [timed] = np.nonzero(times != NO_TIME)
    asked = np.where(times == 0, NOT_LATEST_NS, times)[timed]
    how: dict[str, Any] = {"on_missing": on_missing, **motion.fixed, **motion.policy}
    matrices = np.full((len(times), 4, 4), np.nan)
    try:
        matrices[timed] = BufferCore.lookup_matrices(motion.buffer, *motion.frames, asked, **how)
    except (TransformException, OverflowError) as error:
        failed: Any = error
        if not hasattr(failed, "_row"):  # a frame is unknown, say
            raise
        if motion.fixed:
            _require_target(motion)
        point = timed[failed._row]
        where, advice = f"times[{point}]", ""
        if field is not None:
            number = (int(times[point]) - field.base_ns) / field.unit.ns
            where = f"points[{point}], {field.name} = {number:.16g} {field.unit.text}"
            if sweep.is_long:
                seconds = (sweep.last - sweep.first) / S
                advice = f" (all times span {seconds:g} s: if they are not {field.unit.text}, pass time_unit)"
        raise type(error)(f"{where}: {failed._text}{advice}") from None
    return Poses(None, matrices)
