"""Owns the picture of when transforms were received."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tf2_ros._pictures import labels
from tf2_ros._pictures.plots import BLUE, GREY, ORANGE, VERMILION, style
from tf2_ros._traffic.findings import Limits
from tf2_ros._traffic.streams import Stream, taken

__all__ = ["Heard", "heard_figure", "heard_rows"]

S = 1_000_000_000
Times = NDArray[np.float64]
Style = dict[str, Any]  # arguments for matplotlib

MOST_ROWS = 200
LONGEST_NAME = 30  # characters
WIDTH_IN = 11.0
ROW_IN = 0.55
AROUND_IN = 1.3  # axis and legend
TICKS = (0.08, 0.30)  # where in a row the receptions are, from its lower edge ...
DELAYS = (0.38, 0.92)  # ... and the delays, from 0 to the maximum of the row
SMALLEST = float(np.finfo(float).tiny)
PLACES = 5000  # in the picture's width; of receptions that fall together one is drawn

RECEIVED: Style = {"color": BLUE, "linewidth": 0.7}
DELAY: Style = {"color": ORANGE, "marker": ".", "markersize": 2.5, "linestyle": ""}
STATIC: Style = {"color": GREY, "marker": "D", "markersize": 5, "linestyle": ""}
HOLDS = "--"
GAP: Style = {"facecolor": VERMILION, "alpha": 0.3, "edgecolor": VERMILION, "hatch": "///"}


@dataclass(frozen=True)
class Heard:
    """
    One row: when the transforms of a stream were received.

    :param name: of the frame.
    :param stream: its figures; None where it was not received.
    :param times: in seconds, ascending, shape (N,).
    :param delays: from the stamp to the reception, in seconds, shape (N,).
    :param gap: so long nothing may be received, in seconds; longer is shown.
    """

    name: str
    stream: Stream | None
    times: Times
    delays: Times
    gap: float


def heard_rows(
    records: NDArray[np.void], streams: Sequence[Stream], frames: Sequence[str], limits: Limits
) -> list[Heard]:
    """
    The rows of streams.

    :param records: of ``tf2_ros._receive.recording.RECORD``, in the order of arrival.
    :param streams: as ``Streams.report`` gives them.
    :param frames: names, by the ids in the records.
    :param limits: from where on an interval is a gap.
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
        times = own["received_ns"] / S
        delays = (own["received_ns"] - own["stamp_ns"]) / S
        gap = np.inf if stream.period is None else max(limits.gap, limits.gap_periods * stream.period)
        rows.append(Heard(stream.frame, stream, times, delays, gap))
    return rows


def heard_figure(rows: Sequence[Heard], begin: float, end: float) -> Any:
    """
    Draw one row for each stream, as a figure of matplotlib's.

    :param rows: from above to below; at most the first MOST_ROWS are drawn.
    :param begin: the time at the left, in seconds.
    :param end: the time at the right; it is 0 on the axis.
    """
    from matplotlib.figure import Figure

    drawn = rows[:MOST_ROWS]
    with style():
        figure = Figure((WIDTH_IN, AROUND_IN + ROW_IN * len(drawn)), layout="constrained")
        axes = figure.subplots()
        for place, row in enumerate(drawn):
            _draw_row(axes, row, len(drawn) - 1 - place, begin, end)
        axes.set_xlim(begin - end, 0.0)
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
        more = f" ({len(rows) - len(drawn)} more are not shown)" if len(rows) > len(drawn) else ""
        axes.set_xlabel(f"seconds since {end:.3f}{more}")
        _add_legend(figure)
    return figure


def _draw_row(axes: Any, row: Heard, bottom: int, begin: float, end: float) -> None:
    inside = (row.times >= begin) & (row.times <= end)
    times, delays = row.times[inside] - end, row.delays[inside]
    if row.stream is not None and row.stream.static:
        axes.plot(times, np.full(len(times), bottom + 0.5), **STATIC)
        # It holds from the first one on, and for ever.
        since = max(float(row.times.min(initial=end)), begin) - end
        axes.hlines(bottom + 0.5, since, 0.0, color=GREY, linestyle=HOLDS)
        return
    low, high = (bottom + part for part in TICKS)
    places = np.unique(np.round(times * (PLACES / (end - begin)))) * ((end - begin) / PLACES)
    axes.vlines(places, low, high, **RECEIVED)
    axes.broken_barh(_gaps(row, begin, end), (bottom, 1.0), **GAP)
    if len(delays):
        least, most = min(0.0, float(delays.min())), max(0.0, float(delays.max()))
        low, high = (bottom + part for part in DELAYS)
        axes.plot(times, low + (high - low) * (delays - least) / max(most - least, SMALLEST), **DELAY)


def _gaps(row: Heard, begin: float, end: float) -> list[tuple[float, float]]:
    """Where nothing was received for too long: where this begins, relative to the end, and how long it is."""
    edges = np.append(row.times[row.times <= end], end)
    wide = np.flatnonzero(np.diff(edges) > row.gap)
    starts, stops = np.maximum(edges[wide], begin), edges[wide + 1]
    return [(start - end, stop - start) for start, stop in zip(starts, stops, strict=True) if stop > begin]


def _names(row: Heard) -> str:
    name = labels.label(row.name, LONGEST_NAME)
    return name if row.stream is None else f"{name}\nbelow {labels.label(row.stream.parent, LONGEST_NAME)}"


def _figures(row: Heard) -> str:
    if row.stream is None:
        return "not received"
    publisher = labels.label(row.stream.publisher, LONGEST_NAME)
    return f"{labels.rate(row.stream)}, {publisher}\n{labels.delay(row.stream)}".rstrip()


def _add_legend(figure: Any) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure.legend(
        handles=[
            Line2D([], [], **{**RECEIVED, "linewidth": 1.5}, marker="|", markersize=9, linestyle=""),
            Line2D([], [], **{**DELAY, "markersize": 6}),
            Line2D([], [], **{**STATIC, "linestyle": HOLDS}),
            Patch(**GAP),
        ],
        labels=["received", "delay, up to the maximum of its row", "static: received, and holds", "gap"],
        loc="outside upper center",
        ncols=4,
        frameon=False,
    )
