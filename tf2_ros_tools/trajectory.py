"""
Draw the path of a frame, from above and as components over time.

The functions that draw import matplotlib.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tf2_py import BufferCore, TransformException
from tf2_ros.numpy import to_matrix
from tf2_ros_tools.findings import Limits, longest_interval
from tf2_ros_tools.output import rpy_from_matrices
from tf2_ros_tools.pictures import (
    BLUE,
    GAP,
    GREEN,
    ORANGE,
    VERMILION,
    Records,
    label,
    show_times,
    style,
)
from tf2_ros_tools.program import RunError
from tf2_ros_tools.streams import (
    Stream,
    chain_between,
    moving_on,
    newest_streams,
    stamps_on,
    unknown_ends,
)
from tf2_ros_tools.tables import look_up

S = 1_000_000_000

SIZE_IN = (11.0, 5.5)
LINES: list[dict[str, Any]] = [
    {"color": BLUE, "linestyle": "-"},
    {"color": ORANGE, "linestyle": "--"},
    {"color": GREEN, "linestyle": "-."},
]
ARROWS = 12  # along the path
SMALLEST_M = 1e-3  # of that side; otherwise a frame at rest would be drawn as noise of nanometres
ARROW_SHARE = 0.1  # of the larger side of the path
MANY = 4000  # points of a line; a line with more is an image, because its file would be too large
PIECE = 100_000  # rotations that are matrices at a time

Span = tuple[float, float]  # of time: from when to when, in seconds


def path_picture(
    buffer: BufferCore,
    records: Records,
    streams: Sequence[Stream],
    frames: Sequence[str],
    ends: tuple[str, str],
) -> Any:
    """
    Draw a matplotlib figure of the path of a frame in another frame, at the stamps of the records.

    :param frames: names, indexed by the ids in the records.
    :param ends: the other frame, and the frame whose path is drawn.
    :raises RunError: there is no path.
    """
    target, source = (name.removeprefix("/") for name in ends)
    unknown = unknown_ends(streams, (target, source))
    if unknown:
        raise RunError("; ".join(unknown))
    newest = newest_streams(streams)
    chain = chain_between(newest, target, source)
    if chain is None:
        raise RunError(f"{target} and {source} are not connected")
    stamps = stamps_on(records, frames, newest, chain)
    if not len(stamps):
        raise RunError(f"nothing moves between {target} and {source}")
    try:
        path = look_up(buffer, target, source, stamps).from_first_to_last_answer()
    except TransformException as reason:
        raise RunError(str(reason)) from None
    if not len(path):
        raise RunError(f"the frames between {target} and {source} were never all known at the same time")
    rpy = np.full_like(path.translations, np.nan)
    rpy[path.valid] = rpy_of(path.rotations[path.valid])
    gaps = gaps_on(records, frames, newest, chain)
    return trajectory_figure(target, source, path.stamps_ns / S, path.translations, rpy, gaps)


def gaps_on(
    records: Records, frames: Sequence[str], newest: dict[str, Stream], chain: Sequence[str]
) -> list[Span]:
    """Get the times at which a moving frame of a chain has a gap, by the rules of ``tf2_check``."""
    gaps: list[Span] = []
    for frame in moving_on(newest, chain):
        stamps = stamps_on(records, frames, newest, [frame, newest[frame].parent]) / S
        wide = np.flatnonzero(np.diff(stamps) > longest_interval(newest[frame], Limits()))
        gaps += zip(stamps[wide].tolist(), stamps[wide + 1].tolist(), strict=True)
    return gaps


def rpy_of(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the roll, pitch and yaw of N rotations x y z w, in radians, shape (N, 3)."""
    pieces = np.array_split(rotations, len(rotations) // PIECE + 1)
    return np.concatenate([rpy_from_matrices(to_matrix((np.zeros((len(one), 3)), one))) for one in pieces])


def trajectory_figure(
    target: str,
    source: str,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    rpy: NDArray[np.float64],
    gaps: Iterable[Span] = (),
) -> Any:
    """
    Draw a matplotlib figure of the path of a frame in another frame.

    :param target: the other frame.
    :param source: the frame whose path is drawn.
    :param times: in seconds, ascending, shape (N,), N of 1 or more.
    :param positions: x y z, in metres, shape (N, 3); NaN where it is unknown.
    :param rpy: roll, pitch and yaw, in radians, shape (N, 3); NaN where they are unknown.
    :param gaps: the times between which transforms are missing, so that positions are only interpolated.
        Unknown positions always form a gap.
    """
    from matplotlib.figure import Figure

    with style():
        figure = Figure(SIZE_IN, layout="constrained")
        axes = figure.subplot_mosaic([["above", "upper"], ["above", "lower"]], width_ratios=[1.0, 1.2])
        above, upper, lower = axes["above"], axes["upper"], axes["lower"]
        lower.sharex(upper)
        figure.suptitle(f"{label(source)} in {label(target)}")
        gaps = merged([*gaps, *unknown_spans(times, positions)])
        # Before points are omitted, because the frame may turn between two points that are drawn.
        angles = unwrapped(rpy)
        parted, positions, angles = parted_by(gaps, times, positions, angles)
        _draw_above(above, parted, positions, angles[:, 2], gaps)
        _draw_components(upper, parted, positions, "xyz", "m", gaps)
        _draw_components(lower, parted, angles, ["roll", "pitch", "yaw"], "rad", gaps)
        above.set_xlabel("x in m")
        above.set_ylabel("y in m")
        show_times(lower, times[0], times[-1])
        upper.tick_params(labelbottom=False)
    return figure


# Where transforms are missing.


def unknown_spans(times: NDArray[np.float64], values: NDArray[np.float64]) -> list[Span]:
    """For each run of rows of NaN, get the last known row before it and the first known row after it."""
    known = np.flatnonzero(~np.isnan(values).any(axis=1))
    leaps = np.flatnonzero(np.diff(known) > 1)
    return [*zip(times[known[leaps]].tolist(), times[known[leaps + 1]].tolist(), strict=True)]


def merged(spans: Iterable[Span]) -> list[Span]:
    """Merge overlapping spans, in their order."""
    found: list[Span] = []
    for begin, end in sorted(spans):
        if found and begin < found[-1][1]:
            found[-1] = found[-1][0], max(end, found[-1][1])
        else:
            found.append((begin, end))
    return found


def parted_by(
    gaps: Sequence[Span], times: NDArray[np.float64], *columns: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Replace what is inside each gap by a row of NaN, where a line breaks; return times and values."""
    begins, ends = np.array(gaps).reshape(-1, 2).T
    shown = np.searchsorted(begins, times, "left") == np.searchsorted(ends, times, "right")
    places = np.searchsorted(times[shown], begins, "right")
    parts = [np.insert(times[shown], places, (begins + ends) / 2)]
    return parts + [np.insert(values[shown], places, np.nan, axis=0) for values in columns]


def unwrapped(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Remove jumps by whole turns from the angles in each column; rows of NaN remain."""
    found = angles.copy()
    known = ~np.isnan(angles).any(axis=1)
    found[known] = np.unwrap(angles[known], axis=0)
    return found


# Axes.


def _draw_above(
    axes: Any,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    yaw: NDArray[np.float64],
    gaps: Sequence[Span],
) -> None:
    known = np.flatnonzero(~np.isnan(positions).any(axis=1))
    axes.plot(*positions[:, :2].T, color=BLUE, linewidth=1.5, rasterized=len(times) > MANY)
    if len(known):
        x, y = positions[known, 0], positions[known, 1]
        size = max(float(np.ptp(x)), float(np.ptp(y)), SMALLEST_M)
        chosen = known[np.unique(np.linspace(0, len(known) - 1, ARROWS).astype(int))]
        axes.quiver(
            positions[chosen, 0],
            positions[chosen, 1],
            np.cos(yaw[chosen]),
            np.sin(yaw[chosen]),
            angles="xy",
            scale_units="xy",
            scale=1.0 / (ARROW_SHARE * size),
            width=0.007,
            color=GREEN,
            label="its x axis",
            zorder=3,
        )
        if gaps:
            edges = np.searchsorted(times[known], np.array(gaps), "left").clip(max=len(known) - 1)
            ends = positions[known[edges], :2]
            between = np.concatenate([ends, np.full((len(gaps), 1, 2), np.nan)], axis=1).reshape(-1, 2)
            axes.plot(*between.T, ":", color=VERMILION, linewidth=2, label="gap")
        axes.plot(x[0], y[0], "o", color="white", markeredgecolor="black", label="first", zorder=4)
        axes.plot(x[-1], y[-1], "s", color="black", label="last", zorder=4)
        if size == SMALLEST_M:
            axes.set_xlim(x[0] - size, x[0] + size)
            axes.set_ylim(y[0] - size, y[0] + size)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1)
    axes.set_title("from above")
    axes.grid(color="#E4E4E4")
    axes.set_axisbelow(True)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=4, frameon=False)


def _draw_components(
    axes: Any,
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    names: Sequence[str],
    unit: str,
    gaps: Sequence[Span],
) -> None:
    axes.broken_barh(
        [(begin, end - begin) for begin, end in gaps], (0, 1), transform=axes.get_xaxis_transform(), **GAP
    )
    # Dense lines fill areas that hide each other.
    dense: dict[str, Any] = {"alpha": 0.6, "rasterized": True} if len(times) > MANY else {}
    for name, line, column in zip(names, LINES, values.T, strict=True):
        axes.plot(times, column, label=name, linewidth=1.5, **dense, **line)
    axes.set_ylabel(unit)
    axes.grid(color="#E4E4E4")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
