# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Draw the path of a frame, from above and as components over time.

The functions that draw import matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tf2_py import TransformException, stored_name
from tf2_ros.numpy import to_matrix
from tf2_ros_tools.common.program import RunError
from tf2_ros_tools.common.roll_pitch_yaw import rpy_from_matrices
from tf2_ros_tools.diagnosis.findings import Limits, longest_interval
from tf2_ros_tools.diagnosis.stream_statistics import Stream, newest_streams, stamps_of
from tf2_ros_tools.pictures.style import (
    BLUE,
    GAP,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    Records,
    label,
    show_times,
    style,
)
from tf2_ros_tools.recordings.frames_between import Between, frames_between
from tf2_ros_tools.recordings.pose_tables import look_up, why_unanswered

if TYPE_CHECKING:
    from tf2_ros import Buffer

S = 1_000_000_000

SIZE_IN = (11.0, 5.5)
LINES: list[dict[str, Any]] = [
    {"color": BLUE, "linestyle": "-"},
    {"color": ORANGE, "linestyle": "--"},
    {"color": GREEN, "linestyle": "-."},
]
RECORDED: dict[str, Any] = {"color": GREY, "linestyle": (0, (4, 2)), "linewidth": 1.0, "zorder": 1}
ARROWS = 12  # along the path
ARROWS_WIDE = 12.0  # the width of the axes, in arrows
MANY = 4000  # points of a line; a line with more is an image, because its file would be too large


class Course(NamedTuple):
    """
    Where a frame was at N times, N of 1 or more.

    ``times``: in seconds, ascending, shape (N,). ``positions``: x y z, in meters, shape (N, 3), of which the
    first and the last are known; rows of NaN are gaps. ``rpy``: roll, pitch and yaw, in radians, shape
    (N, 3); NaN where the positions are.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    rpy: NDArray[np.float64]


def path_picture(
    buffer: Buffer,
    records: Records,
    streams: Sequence[Stream],
    frames: Sequence[str],
    ends: tuple[str, str],
    *,
    before: Buffer | None = None,
    corrected: str | None = None,
) -> Any:
    """
    Draw a matplotlib figure of the path of a frame in another frame, at the stamps of the records.

    :param frames: names, indexed by the ids in the records.
    :param ends: the other frame, and the frame whose path is drawn.
    :param before: a buffer as it was before a trajectory corrected it, whose path is drawn, too.
    :param corrected: the frame that it has corrected, whose recorded gaps do not matter any more.
    :raises RunError: there is no path.
    """
    target, source = map(stored_name, ends)
    try:
        between = frames_between(buffer, buffer.histories(), target, source)
    except TransformException as reason:
        raise RunError(str(reason)) from None
    newest = newest_streams(streams)
    stamps = between.stamps(records, frames)
    if not len(stamps):
        raise RunError(f"nothing moves between {target} and {source}")
    drawn = _course(buffer, target, source, stamps, gaps_on(records, frames, newest, between, corrected))
    if drawn is None:
        raise RunError(why_unanswered(buffer, target, source, stamps))
    recorded, name, old_target = None, "recorded", target
    if before is not None:
        # Nothing was recorded in a new frame above the corrected one.
        if target not in before.frames() and corrected is not None and buffer.parent(corrected) == target:
            old_target, name = corrected, f"recorded, in {corrected}"
        with suppress(TransformException):
            between = frames_between(before, before.histories(), old_target, source)
            gaps = gaps_on(records, frames, newest, between)
            recorded = _course(before, old_target, source, stamps, gaps)
    return trajectory_figure(target, source, *drawn, recorded=recorded, name_of_recorded=name)


def _course(
    buffer: Buffer,
    target: str,
    source: str,
    stamps: NDArray[np.int64],
    gaps: tuple[NDArray[np.int64], NDArray[np.int64]],
) -> Course | None:
    """Look up a path at some stamps, except within the gaps between others; None: it is never known."""
    begins, ends = gaps
    # Where a frame has a gap, a pose is only interpolated. One time inside each is enough to break lines.
    times_ns = np.union1d(stamps, begins + (ends - begins) // 2)
    poses = look_up(buffer, target, source, times_ns)
    begun = np.searchsorted(np.sort(begins), times_ns)
    poses[begun > np.searchsorted(np.sort(ends), times_ns, "right")] = np.nan
    known = np.flatnonzero(~np.isnan(poses[:, 0]))
    if not len(known):
        return None
    rpy = np.full((len(poses), 3), np.nan)
    turns = rpy_from_matrices(to_matrix((poses[known, :3], poses[known, 3:])))
    rpy[known] = np.unwrap(turns, axis=0)  # without jumps by whole turns
    shown = slice(known[0], known[-1] + 1)
    return Course(times_ns[shown] / S, poses[shown, :3], rpy[shown])


def gaps_on(
    records: Records,
    frames: Sequence[str],
    newest: dict[str, Stream],
    between: Between,
    corrected: str | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """
    Get the stamps between which a frame that moves has a gap, by the rules of ``tf2_check``.

    :param corrected: a frame whose gaps do not count. None: there is none.
    """
    begins, ends = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for frame in between.moving.keys() - {corrected}:
        stamps = stamps_of(records, frames, frame)
        wide = np.flatnonzero(np.diff(stamps) > longest_interval(newest[frame], Limits()) * S)
        wide = wide[between.counts(frame, stamps[wide])]
        begins.append(stamps[wide])
        ends.append(stamps[wide + 1])
    return np.concatenate(begins), np.concatenate(ends)


def trajectory_figure(
    target: str,
    source: str,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    rpy: NDArray[np.float64],
    *,
    recorded: Course | None = None,
    name_of_recorded: str = "",
) -> Any:
    """
    Draw a matplotlib figure of the path of a frame in another frame.

    :param target: the other frame.
    :param source: the frame whose path is drawn.
    :param times: see :class:`Course`.
    :param positions: see :class:`Course`.
    :param rpy: see :class:`Course`.
    :param recorded: the path before it was corrected, which is drawn in gray. None: it was not.
    :param name_of_recorded: for the legend.
    """
    from matplotlib.figure import Figure

    known = np.flatnonzero(~np.isnan(positions[:, 0]))
    leaps = np.flatnonzero(np.diff(known) > 1)
    gaps = np.stack([known[leaps], known[leaps + 1]], axis=1)  # the rows at both ends of each
    with style():
        figure = Figure(SIZE_IN, layout="constrained")
        axes = figure.subplot_mosaic([["above", "upper"], ["above", "lower"]], width_ratios=[1.0, 1.2])
        above, upper, lower = axes["above"], axes["upper"], axes["lower"]
        lower.sharex(upper)
        figure.suptitle(f"{label(source)} in {label(target)}")
        first, last = times[0], times[-1]
        if recorded is not None:
            first, last = min(first, recorded.times[0]), max(last, recorded.times[-1])
            line: dict[str, Any] = {**RECORDED, "rasterized": len(recorded.times) > MANY}
            above.plot(*recorded.positions[:, :2].T, label=label(name_of_recorded), **line)
            upper.plot(recorded.times, recorded.positions, label="_recorded", **line)
            lower.plot(recorded.times, recorded.rpy, label="_recorded", **line)
        _draw_above(above, positions, rpy[:, 2], known, gaps, "" if recorded is None else "corrected")
        _draw_components(upper, times, positions, "xyz", "m", gaps)
        _draw_components(lower, times, rpy, ["roll", "pitch", "yaw"], "rad", gaps)
        show_times(lower, first, last)
        upper.tick_params(labelbottom=False)
    return figure


def _draw_above(
    axes: Any,
    positions: NDArray[np.float64],
    yaw: NDArray[np.float64],
    known: NDArray[np.intp],
    gaps: NDArray[np.intp],
    name: str,
) -> None:
    from matplotlib.collections import LineCollection

    x, y = positions[:, :2].T
    axes.plot(x, y, color=BLUE, linewidth=1.5, rasterized=len(x) > MANY, label=name or "_path")
    some = known[np.unique(np.linspace(0, len(known) - 1, ARROWS).astype(int))]
    axes.quiver(
        x[some],
        y[some],
        np.cos(yaw[some]),
        np.sin(yaw[some]),
        scale=ARROWS_WIDE,
        scale_units="width",
        width=0.007,
        color=GREEN,
        label="its x axis",
        zorder=3,
    )
    if len(gaps):
        ends = [*positions[gaps, :2]]
        axes.add_collection(LineCollection(ends, linestyles=":", colors=VERMILION, linewidths=2, label="gap"))
    axes.plot(x[0], y[0], "o", color="white", markeredgecolor="black", label="first", zorder=4)
    axes.plot(x[-1], y[-1], "s", color="black", label="last", zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1)
    axes.set(title="from above", xlabel="x in m", ylabel="y in m")
    axes.grid(color="#E4E4E4")
    axes.set_axisbelow(True)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=5, frameon=False)


def _draw_components(
    axes: Any,
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    names: Sequence[str],
    unit: str,
    gaps: NDArray[np.intp],
) -> None:
    spans = [(begin, end - begin) for begin, end in times[gaps]]
    axes.broken_barh(spans, (0, 1), transform=axes.get_xaxis_transform(), **GAP)
    # Dense lines fill areas that hide each other.
    dense: dict[str, Any] = {"alpha": 0.6, "rasterized": True} if len(times) > MANY else {}
    for name, line, column in zip(names, LINES, values.T, strict=True):
        axes.plot(times, column, label=name, linewidth=1.5, **dense, **line)
    axes.set_ylabel(unit)
    axes.grid(color="#E4E4E4")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
