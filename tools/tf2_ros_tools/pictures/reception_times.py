# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Draw when transforms were received, with matplotlib."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tf2_py import stored_name
from tf2_ros_tools.common.output import not_known
from tf2_ros_tools.common.program import RunError
from tf2_ros_tools.diagnosis.findings import Limits, longest_interval
from tf2_ros_tools.diagnosis.stream_statistics import Stream, taken
from tf2_ros_tools.diagnosis.texts import delay_label, rate_label
from tf2_ros_tools.pictures.style import BLUE, GAP, GREY, ORANGE, Records, Style, label, show_times, style

S = 1_000_000_000
Times = NDArray[np.float64]

MOST_ROWS = 200
LONGEST_NAME = 30  # characters
WIDTH_IN = 11.0
ROW_IN = 0.55
AROUND_IN = 1.3  # axis and legend
TICKS = (0.08, 0.30)  # where in a row the receptions are, from its lower edge ...
DELAYS = (0.38, 0.92)  # ... and the delays, from 0 to the maximum of the row
SMALLEST = float(np.finfo(float).tiny)
PLACES = 5000  # of the picture's width; one reception is drawn in each

NOT_YET: Style = {"facecolor": "#F0F0F0", "edgecolor": "#C4C4C4", "hatch": "..."}


class Row(NamedTuple):
    """A row of the picture: when the transforms of a stream were received."""

    stream: Stream  # its figures
    times: Times  # in seconds, ascending, shape (N,)
    delays: Times  # from the stamp to the reception, in seconds, shape (N,)

    @property
    def gap(self) -> float:
        """The longest time between two receptions that is not shown as a gap, in seconds."""
        return longest_interval(self.stream, Limits())


def heard_rows(records: Records, streams: Sequence[Stream], frames: Sequence[str]) -> list[Row]:
    """
    Make the rows of streams.

    :param records: ``tf2_ros.records.RECORD``, in the order of arrival.
    :param streams: the result of ``Streams.report``.
    :param frames: names, indexed by the ids in the records.
    """
    numbers = {name: number for number, name in enumerate(frames)}
    records = taken(records)
    records = records[np.argsort(records["child"], kind="stable")]
    rows = []
    for stream in streams:
        child = numbers[stream.frame]
        first, last = np.searchsorted(records["child"], [child, child + 1])
        own = records[first:last]
        own = own[
            (own["parent"] == numbers[stream.parent])
            & (own["publisher"] == stream.publisher_id)
            & (own["static"] == stream.static)
        ]
        received = own["received_ns"]
        rows.append(Row(stream, received / S, (received - own["stamp_ns"]) / S))
    return rows


def heard_figure(rows: Sequence[Row], begin: float, end: float) -> Any:
    """
    Draw a matplotlib figure with one row for each stream.

    :param rows: from top to bottom; at most the first MOST_ROWS are drawn.
    :param begin: the time at the left edge, in seconds.
    :param end: the time at the right edge.
    """
    from matplotlib.figure import Figure

    drawn = rows[:MOST_ROWS]
    with style():
        figure = Figure((WIDTH_IN, AROUND_IN + ROW_IN * len(drawn)), layout="constrained")
        axes = figure.subplots()
        for place, row in enumerate(drawn):
            _draw_row(axes, row, len(drawn) - 1 - place, begin, end)
        show_times(axes, begin, end)
        right = axes.twinx()
        for side, text_of in ((axes, _names), (right, _figures)):
            side.set_ylim(0.0, len(drawn))
            side.set_yticks(np.arange(len(drawn)) + 0.5, [text_of(row) for row in reversed(drawn)])
            side.tick_params(axis="y", length=0)
            side.set_frame_on(False)
        axes.set_yticks(np.arange(len(drawn) + 1), minor=True)
        axes.grid(axis="y", which="minor", color="#D8D8D8")
        axes.grid(axis="x", color="#EEEEEE")
        axes.set_axisbelow(True)
        if len(rows) > len(drawn):
            axes.set_xlabel(f"{axes.get_xlabel()}; {len(rows) - len(drawn)} more rows are not shown")
        # Each row has its own handles.
        handles, labels = axes.get_legend_handles_labels()
        by_label = dict(zip(labels, handles, strict=True))
        figure.legend(by_label.values(), by_label, loc="outside upper center", ncols=5, frameon=False)
    return figure


def _draw_row(axes: Any, row: Row, bottom: int, begin: float, end: float) -> None:
    inside = (row.times >= begin) & (row.times <= end)
    times, delays = row.times[inside], row.delays[inside]
    since = max(float(row.times.min(initial=end)), begin)
    if since - begin > (0.0 if row.stream.static else row.gap):
        axes.broken_barh([(begin, since - begin)], (bottom, 1.0), **NOT_YET, label="not received yet")
    if row.stream.static:
        middle = np.full(len(times), bottom + 0.5)
        axes.plot(times, middle, "D", color=GREY, markersize=5, label="static: received, and valid since")
        # It is valid from the first reception on, without an end.
        axes.hlines(bottom + 0.5, since, end, color=GREY, linestyle="--")
        return
    low, high = (bottom + part for part in TICKS)
    step = (end - begin) / PLACES
    places = begin + step * np.unique(np.round((times - begin) / step))
    axes.vlines(places, low, high, color=BLUE, linewidth=0.7, label="received")
    axes.broken_barh(_gaps(row, begin, end), (bottom, 1.0), **GAP, label="gap")
    if len(delays) and row.stream.delay is not None:
        least, most = min(0.0, float(delays.min())), max(0.0, float(delays.max()))
        low, high = (bottom + part for part in DELAYS)
        heights = low + (high - low) * (delays - least) / max(most - least, SMALLEST)
        about = "delay, up to the maximum of its row"
        axes.plot(times, heights, ".", color=ORANGE, markersize=2.5, label=about)


def _gaps(row: Row, begin: float, end: float) -> list[tuple[float, float]]:
    """Get the gaps, in which nothing was received for too long: when each begins, and how long it is."""
    edges = np.append(row.times[row.times <= end], end)
    wide = np.flatnonzero(np.diff(edges) > row.gap)
    starts, stops = np.maximum(edges[wide], begin), edges[wide + 1]
    return [(start, stop - start) for start, stop in zip(starts, stops, strict=True) if stop > begin]


def _names(row: Row) -> str:
    return f"{label(row.stream.frame, LONGEST_NAME)}\nbelow {label(row.stream.parent, LONGEST_NAME)}"


def _figures(row: Row) -> str:
    publisher = label(row.stream.publisher, LONGEST_NAME)
    return f"{rate_label(row.stream)}, {publisher}\n{delay_label(row.stream)}".rstrip()


def heard_picture(
    records: Records,
    streams: Sequence[Stream],
    frames: Sequence[str],
    wanted: Sequence[str],
    span: tuple[float, float],
) -> Any:
    """
    Draw a matplotlib figure of when transforms were received.

    :param frames: names, indexed by the ids in the records.
    :param wanted: the frames to draw, in this order; if empty, all frames.
    :param span: the first and the last time, in seconds.
    :raises RunError: no transform of a wanted frame was received.
    """
    names = [*map(stored_name, wanted)]
    own = {name: [one for one in streams if one.frame == name] for name in names}
    lacking = [
        f"no valid transform of {name} was received; for a path, use --path"
        if name in frames
        else not_known(name, frames)
        for name in names
        if not own[name]
    ]
    if lacking:
        raise RunError("; ".join(lacking))
    chosen = [one for name in names for one in own[name]] if names else streams
    return heard_figure(heard_rows(records, chosen, frames), *span)
