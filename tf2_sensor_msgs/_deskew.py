"""Deskew a cloud: transform each point from where the sensor was when it measured that point."""

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField

from tf2_py._internal import as_times_ns, duration_ns, errors, time_ns
from tf2_ros import BufferCore, ExtrapolationException, FrameInfo, TransformException
from tf2_ros._arguments import frame_of
from tf2_ros_cython.output import printable
from tf2_sensor_msgs._cloud import largest_bends, move_points, read_times, sampled_range, split_times
from tf2_sensor_msgs._errors import FieldError

if TYPE_CHECKING:
    from tf2_py.typing import DurationLike, DurationsLike, TimeLike, TimesLike

S = 1_000_000_000
# A ROS stamp holds no more seconds than these. So a larger number in a `timestamp` is nanoseconds.
MOST_SECONDS = 2.0**31
# No time, in seconds or nanoseconds, is as far from 0, and no sweep takes as long.
HIGHEST, LONGEST_NS = 9.2e18, 3600 * S
# Between two knots, poses change steadily. The elements of a rotation matrix, and the translation in metres,
# then differ from exact ones by little more than this; a point, by at most 1e-6 of its distance and 10 µm.
ROTATION_BOUND, TRANSLATION_BOUND = 2.5e-7, 5e-6
PARTS = 40  # of a sweep, or as many as there are stamps of samples: within each, the motion is nearly steady
# With more knots than one for this many points, lookups for all points cost no more.
POINTS_PER_KNOT = 8
# How far a pose in the middle of a part may differ, before more parts are looked at; the frames then turn by
# 50 degrees within one.
FAR = 0.1


class Unit(NamedTuple):
    """What the number in a time field means: the ``TimeUnit`` of ``parts/deskew.pyx``."""

    code: int
    text: str


SECONDS, NANOSECONDS = Unit(0, "s after the stamp"), Unit(1, "ns after the stamp")
SINCE_1970_S, SINCE_1970_NS = Unit(2, "s since 1970"), Unit(3, "ns since 1970")
NAMES = {
    PointField.INT8: "int8",
    PointField.UINT8: "uint8",
    PointField.INT16: "int16",
    PointField.UINT16: "uint16",
    PointField.INT32: "int32",
    PointField.UINT32: "uint32",
    PointField.FLOAT32: "float32",
    PointField.FLOAT64: "float64",
}
# The fields that drivers of lidars write: Velodyne; Ouster; Livox; Hesai and Livox, in different units.
KNOWN = {
    "time": ((PointField.FLOAT32, PointField.FLOAT64), SECONDS),
    "t": ((PointField.UINT32,), NANOSECONDS),
    "offset_time": ((PointField.UINT32,), NANOSECONDS),
    "timestamp": ((PointField.FLOAT64,), SINCE_1970_S),
}


class Poses(NamedTuple):
    """Poses between which the points move steadily, as ``move_points`` takes them."""

    knots: NDArray[np.int64] | None
    matrices: NDArray[np.float64]


class Motion(NamedTuple):
    """The arguments of the lookups of one cloud."""

    buffer: BufferCore
    target_frame: str
    source_frame: str
    fixed: dict[str, Any]  # fixed_frame and target_time, or nothing
    policy: dict[str, Any]  # tolerance, extrapolate and max_gap

    def matrices(self, times: NDArray[np.int64], **how: Any) -> NDArray[np.float64]:
        # At least 1, because 0 would mean "latest".
        return BufferCore.lookup_matrices(
            self.buffer,
            self.target_frame,
            self.source_frame,
            np.maximum(times, 1),
            **self.fixed,
            **how,
            **self.policy,
        )


def deskew(
    cloud: PointCloud2,
    buffer: BufferCore,
    target_frame: str,
    fixed_frame: str | None = None,
    target_time: "TimeLike | None" = None,
    *,
    times: "TimesLike | None" = None,
    timeout: "DurationLike" = 0,
    on_missing: Literal["raise", "nan"] = "raise",
    prefix: str = "",
    tolerance: "DurationsLike | None" = None,
    extrapolate: bool = False,
    max_gap: "DurationLike | None" = None,
) -> PointCloud2:
    """
    Transform each point of a cloud from where the sensor was when it measured that point.

    :param cloud: the points, in metres, and the time of each in one of these fields, which the drivers of
        Velodyne, Ouster, Livox and Hesai write: ``time`` (float32 or float64: seconds after the cloud's
        stamp, also negative), ``t`` or ``offset_time`` (uint32: nanoseconds after the stamp), ``timestamp``
        (float64: seconds since 1970, or nanoseconds from 2^31 on).
    :param buffer: the transforms.
    :param target_frame: the frame to transform the points into. Without ``fixed_frame``, one in which the
        sensor moves, such as ``odom``.
    :param fixed_frame: a frame that does not move, such as ``odom``, if ``target_frame`` itself moves, such
        as the frame of the robot or the cloud's own: the points are transformed into the target frame at
        ``target_time``.
    :param target_time: only with ``fixed_frame``; 0: the latest common time of both frames. None: the stamp
        of the cloud.
    :param times: the time of each point, row by row, as for ``buffer.lookup_transforms``, instead of a field.
    :param timeout: how long to wait for the transforms of the last point; only for a ``tf2_ros.Buffer``.
    :param on_missing: ``'raise'`` raises the error of the first point for whose time there is no transform,
        with its index; ``'nan'`` makes the coordinates of such points NaN.
    :param prefix: put before the frame of the cloud, as in ``buffer.transform``.
    :param tolerance: what the lookups accept beyond tf2's, as ``extrapolate`` and ``max_gap``; see
        :class:`tf2_py.typing.LookupPolicy`. There is no ``max_age``, because points have times.
    :return: a new PointCloud2 in ``target_frame``, with the stamp of ``cloud``, or ``target_time``. All else
        stays, but with ``fixed_frame`` the time field of each point becomes that of the new stamp.
    :raises TransformException: a point has no transform; see ``buffer.lookup_transform``.
    :raises TypeError: an argument is of another type, or there is a ``target_time`` without ``fixed_frame``.
    :raises ValueError: no field has the times of the points (the text names the fields), a time is not a
        number, the cloud is inconsistent as for :func:`do_transform_cloud`, or the sensor does not move in
        ``fixed_frame``, or without one in ``target_frame``, because that frame is the sensor's or moves with
        it.

    Points with a NaN need no time, and have three NaN in the result. Normals and viewpoints are transformed,
    too. Poses are looked up at some times, and between these the points move steadily. There are so many of
    these times that a point is off by at most 10 µm and a millionth of its distance from the sensor. Where
    this would not save time, the pose of each point is looked up.
    """
    if not isinstance(buffer, BufferCore):
        raise TypeError(f"buffer: expected a tf2_ros.Buffer, got {type(buffer).__name__}")
    if on_missing not in ("raise", "nan"):
        raise ValueError(f"on_missing: expected 'raise' or 'nan', got {on_missing!r}")
    if target_time is not None and fixed_frame is None:
        raise TypeError("target_time needs a fixed_frame")
    source_frame = frame_of(cloud.header, prefix)
    stamp_ns = new_ns = time_ns(cloud.header.stamp, "header.stamp")
    fixed: dict[str, Any] = {}
    if fixed_frame is not None:
        new_ns = _target_ns(buffer, target_frame, fixed_frame, target_time, stamp_ns)
        fixed = {"fixed_frame": fixed_frame, "target_time": max(new_ns, 1)}
    policy = {"tolerance": tolerance, "extrapolate": extrapolate, "max_gap": max_gap}
    motion = Motion(buffer, target_frame, source_frame, fixed, policy)
    sweep = _read_sweep(cloud, stamp_ns, times)
    _wait(motion, sweep.last, timeout, on_missing)
    stored = {SINCE_1970_S: new_ns / S, SINCE_1970_NS: float(new_ns)}.get(sweep.unit, 0.0) if fixed else None

    def moved(poses: Poses, is_dense: bool) -> tuple[PointCloud2, bool]:
        time = sweep.name, sweep.unit.code, stamp_ns, stored if sweep.name else None, sweep.times
        return move_points(cloud, new_ns, target_frame, is_dense, *time, *poses)

    steady = _steady_poses(motion, sweep)
    if sweep.size and (steady is None or _may_rest(steady)):
        _require_motion(buffer, source_frame, target_frame, fixed_frame)
    if steady is not None:
        message, is_complete = moved(steady, cloud.is_dense)
        if is_complete:
            return message
    # The sample missed the first or the last time, or a point lacks a time or a transform, or there are few.
    all_times = np.empty(cloud.height * cloud.width, np.int64) if sweep.times is None else sweep.times.copy()
    first, last, bad = read_times(cloud, sweep.name, sweep.unit.code, stamp_ns, all_times)
    if bad >= 0 and on_missing == "raise":
        raise ValueError(f"points[{bad}]: {sweep.name} is not a time")
    _wait(motion, last, timeout, on_missing)
    if bad < 0 and (first, last) != (sweep.first, sweep.last):
        steady = _steady_poses(motion, sweep._replace(first=first, last=last))
        if steady is not None:
            return moved(steady, cloud.is_dense)[0]
    exact = _exact_poses(motion, all_times, first, on_missing)
    is_missing = bool(np.isnan(exact.matrices[:, 0, 0]).any())
    return moved(exact, cloud.is_dense and not is_missing)[0]


class Sweep(NamedTuple):
    """The times of a cloud's points: in a field, or given."""

    name: str | None
    unit: Unit
    times: NDArray[np.int64] | None
    first: int  # ns, of a sample of the points; later than `last` if there are none
    last: int
    size: int  # how many points


def _read_sweep(cloud: PointCloud2, stamp_ns: int, times: "TimesLike | None") -> Sweep:
    count = cloud.height * cloud.width
    if times is not None:
        given = as_times_ns(times)
        if len(given) != count:
            raise ValueError(f"{count} points, {len(given)} times: each point needs its own time")
        first, last = (int(given.min()), int(given.max())) if count else (0, -1)
        return Sweep(None, SECONDS, given, first, last, count)
    name, unit = _time_field(cloud)
    lowest, highest = sampled_range(cloud, name)
    if unit is SINCE_1970_S and highest >= MOST_SECONDS:
        unit = SINCE_1970_NS
    if not -HIGHEST < lowest <= highest < HIGHEST:
        return Sweep(name, unit, None, 0, -1, count)
    first, last = (_nanoseconds(value, unit, stamp_ns) for value in (lowest, highest))
    return Sweep(name, unit, None, first, last, count)


def _nanoseconds(value: float, unit: Unit, stamp_ns: int) -> int:
    if unit in (SECONDS, SINCE_1970_S):
        ns = int(value) * S + round((value - int(value)) * 1e9)
    else:
        ns = int(value)
    return ns if unit in (SINCE_1970_S, SINCE_1970_NS) else stamp_ns + ns


def _time_field(cloud: PointCloud2) -> tuple[str, Unit]:
    datatypes = {field.name: field.datatype for field in reversed(list(cloud.fields))}
    for name, (accepted, unit) in KNOWN.items():
        if datatypes.get(name) in accepted:
            return name, unit
    found = _listed(f"{printable(field.name)} ({NAMES.get(field.datatype, '?')})" for field in cloud.fields)
    known = _listed(
        f"{name} ({' or '.join(NAMES[datatype] for datatype in accepted)})"
        for name, (accepted, _) in KNOWN.items()
    )
    raise FieldError(
        f"no field has the times of the points: the cloud has {found}; known are {known}. "
        "For others, pass times"
    )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "no fields"


def _target_ns(
    buffer: BufferCore, target_frame: str, fixed_frame: str, target_time: "TimeLike | None", stamp_ns: int
) -> int:
    target_ns = stamp_ns if target_time is None else time_ns(target_time, "target_time")
    if target_time is not None and target_ns == 0:
        target_ns = buffer.get_latest_common_time(target_frame, fixed_frame).nanoseconds
    return target_ns or stamp_ns


def _may_rest(poses: Poses) -> bool:
    """Whether the sensor is at the end where it was at the beginning."""
    return bool((poses.matrices[0] == poses.matrices[-1]).all())


def _require_motion(
    buffer: BufferCore, source_frame: str, target_frame: str, fixed_frame: str | None
) -> None:
    """Refuse a frame that moves together with the sensor: nothing would be corrected."""
    frame = fixed_frame or target_frame
    try:
        if frame != source_frame and buffer.get_latest_common_time(frame, source_frame).nanoseconds:
            return
    except TransformException:
        return  # the lookups say why
    frames = buffer.frames()
    body = _body(frames, frame, source_frame)
    moves_in = frames[body].parent if body in frames else None
    if moves_in is None and frame == source_frame:
        raise ValueError(
            f"[{printable(frame)}] does not move in itself: pass a fixed_frame in which it moves"
        )
    if moves_in is None or body != _body(frames, source_frame, frame):
        return
    given, wanted = ("fixed_frame ", "another") if fixed_frame else ("", "a fixed_frame")
    raise ValueError(
        f"[{printable(source_frame)}] does not move in {given}[{printable(frame)}], which moves itself: "
        f"pass {wanted}, for example [{printable(moves_in)}]"
    )


def _body(frames: dict[str, FrameInfo], frame: str, other: str) -> str:
    """The topmost frame that a frame is fixed to."""
    passed: set[str] = set()
    while frame in frames and frames[frame].static and (parent := frames[frame].parent) is not None:
        if frame in passed:
            raise errors.loop(frame, other)
        passed.add(frame)
        frame = parent
    return frame


def _wait(motion: Motion, last: int, timeout: "DurationLike", on_missing: str) -> None:
    """Wait for the transform of the last point; with ``'nan'``, the lookups decide what is missing."""
    if duration_ns(timeout, "timeout") <= 0 or last < 0:
        return
    buffer: Any = motion.buffer
    target, source, time = motion.target_frame, motion.source_frame, max(last, 1)
    try:
        if motion.fixed:
            fixed_frame, target_time = motion.fixed["fixed_frame"], motion.fixed["target_time"]
            buffer.lookup_transform_full(
                target, target_time, source, time, fixed_frame, timeout, **motion.policy
            )
        else:
            buffer.lookup_transform(target, source, time, timeout, **motion.policy)
    except ExtrapolationException:
        if on_missing == "raise":
            raise


def _steady_poses(motion: Motion, sweep: Sweep) -> Poses | None:
    """Poses from the first to the last time, with a steady motion between them; None: they would be many."""
    first, last, count = sweep.first, sweep.last, sweep.size
    if not 0 <= last - first <= LONGEST_NS:
        return None
    target_frame = motion.fixed.get("fixed_frame", motion.target_frame)
    edges = motion.buffer._stamps_between(target_frame, motion.source_frame, first, last)
    if edges is None:
        return None
    parts = math.ceil(PARTS / len(edges))
    # Twice as many, to see by how much the pose in the middle of each part differs from a steady change.
    knots = split_times(edges, 2 * parts)
    if len(knots) * POINTS_PER_KNOT > count:
        return None
    try:
        matrices = motion.matrices(knots)
        turn, move = largest_bends(matrices)
        if turn > FAR:
            return None
        # In pieces of a part, the difference decreases with the square of their number.
        pieces = math.ceil(math.sqrt(max(turn / ROTATION_BOUND, move / TRANSLATION_BOUND)))
        if pieces > 2:
            if parts * pieces * len(edges) * POINTS_PER_KNOT > count:
                return None
            knots = split_times(edges, parts * pieces)
            matrices = motion.matrices(knots)
    except ExtrapolationException:
        return None  # at which point, or under which policy, the exact lookups say
    return Poses(knots, matrices)


def _exact_poses(motion: Motion, times: NDArray[np.int64], first: int, on_missing: str) -> Poses:
    """One pose for each point; NaN for points without a time."""
    without = times == np.iinfo(np.int64).min
    if without.all():
        matrices = np.full((len(times), 4, 4), np.nan)
    else:
        matrices = motion.matrices(np.where(without, first, times), on_missing=on_missing)
        matrices[without] = np.nan
    return Poses(None, matrices)
