"""
Draw the tree of frames, and when transforms were received.

The functions import what they need: graphviz for the tree, matplotlib for the other pictures. Names of frames
and publishers come from the network and may contain anything: ``label`` makes them fit.
"""

import re
import warnings
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime, timezone
from io import BytesIO
from textwrap import wrap
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tf2_py import FrameInfo, stored_name
from tf2_py.printable import printable
from tf2_ros_tools.findings import Finding, Limits, delay_label, longest_interval, rate_label
from tf2_ros_tools.output import not_known, require, write_whole
from tf2_ros_tools.program import RunError, UsageError, format_of
from tf2_ros_tools.streams import Stream, taken

S = 1_000_000_000

Records = NDArray[np.void]

# Colours that everyone can distinguish (M. Okabe and K. Ito, Color universal design, 2008), and grey.
BLUE, ORANGE, GREEN, VERMILION, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#6E6E6E"
LONGEST = 60  # characters of a name


def label(text: str, longest: int = LONGEST) -> str:
    """Escape unprintable characters, and remove the middle of a text that is too long."""
    shown, half = printable(text), longest // 2
    return shown if len(shown) <= longest + 1 else f"{shown[:half]}…{shown[-half:]}"


# The tree of frames.


# The styles also work without colour.
STYLES = {
    "dynamic": {"color": BLUE, "style": "solid", "penwidth": "1.6"},
    "static": {"color": GREY, "style": "dashed", "penwidth": "1.2"},
    "stale": {"color": VERMILION, "style": "dotted", "penwidth": "3"},
}
PROBLEM = {"color": VERMILION, "fontcolor": "#A83E00", "penwidth": "3"}
GROUND = " "  # the last line of an edge's label, because Graphviz draws the edge just below it
FONT = {"fontname": "Helvetica", "fontsize": "11"}
LONGEST_FINDING = 120  # characters
REASON_WIDTH = 32  # characters of a line
# Names that can be ids of nodes. Other characters may have a meaning for Graphviz, such as the colon.
PLAIN_NAME = re.compile(r"[\w/. -]{1,200}")
PAGE_IN = "180,180"  # a larger picture is scaled: a page of PDF has at most 200 inches


def tree_dot(
    streams: Sequence[Stream],
    findings: Sequence[Finding] = (),
    infos: Mapping[str, FrameInfo] = MappingProxyType({}),
    time: float | None = None,
) -> str:
    """
    Describe the tree in DOT: an edge for each stream, from the parent to the frame.

    :param streams: the result of ``Streams.report``.
    :param findings: what is wrong with them; written on the edges of the frames, and below the tree.
    :param infos: the frames of a buffer.
    :param time: the time of the report, in seconds of the clock of the streams.
    """
    import graphviz

    dot = graphviz.Digraph(
        "G",
        # From left to right, a robot with many links fits on a page or into a window.
        graph_attr={
            **FONT,
            "rankdir": "LR",
            "size": PAGE_IN,
            "labelloc": "b",
            "labeljust": "l",
            "label": _lines([label(one.text, LONGEST_FINDING) for one in findings], "\\l"),
        },
        node_attr={**FONT, "shape": "box", "style": "rounded,filled", "fillcolor": "#F4F6F8"},
        edge_attr={**FONT, "fontsize": "10", "arrowsize": "0.7"},
    )
    problems = _problems(findings, streams)
    stale = {finding.frame for finding in findings if finding.kind == "stale"}
    drawn = {name for one in streams for name in (one.frame, one.parent)}
    names = sorted(drawn | problems.keys())
    ids = {name: name if PLAIN_NAME.fullmatch(name) else f"#{place}" for place, name in enumerate(names)}
    for name in names:
        # What has no edge has problems: all its transforms are refused.
        text = _lines([label(name), *([] if name in drawn else problems[name])], "\\n")
        look = {"class": "frame"} if name in drawn else {**PROBLEM, "class": "problem"}
        dot.node(ids[name], text, tooltip=text, **look)
    for stream in streams:
        kind = "static" if stream.static else "stale" if stream.frame in stale else "dynamic"
        reasons = problems.get(stream.frame, [])
        facts, stamps = _facts(stream, infos.get(stream.frame))
        facts += reasons
        dot.edge(
            ids[stream.parent],
            ids[stream.frame],
            _lines([*facts, GROUND], "\\n"),
            tooltip=_lines([*facts, *stamps], "\\n"),
            **{
                **STYLES[kind],
                **(PROBLEM if reasons else {}),
                "class": f"{'problem ' * bool(reasons)}{kind}",
            },
        )
    if not streams:
        dot.node("#nothing", "no transform was received", shape="plaintext", style="")
    _add_tree_legend(dot, time)
    source: str = dot.source
    return source


def _problems(findings: Sequence[Finding], streams: Sequence[Stream]) -> dict[str, list[str]]:
    """Get the lines that mark the edges of each frame, by the name of the frame."""
    problems: dict[str, list[str]] = {}
    publishers: dict[str, set[str]] = {}
    for stream in streams:
        publishers.setdefault(stream.frame, set()).add(stream.publisher)
    for finding in findings:
        # What is about the whole tree names no frame, and has its place below the tree.
        for frame in finding.frames or filter(None, (finding.frame,)):
            text = finding.text.removeprefix(f"{frame} ")
            if len(names := publishers.get(frame, ())) == 1:
                text = text.removeprefix(f"by {min(names)} ")  # which the edge shows
            text = label(text, LONGEST_FINDING)
            problems.setdefault(frame, []).extend(wrap(text, REASON_WIDTH))
    return problems


def _facts(stream: Stream, info: FrameInfo | None) -> tuple[list[str], list[str]]:
    """Get the lines of an edge's label, and the stamps that only its tooltip shows."""
    facts = [label(stream.publisher), rate_label(stream)]
    if stream.delay is not None:
        facts.append(delay_label(stream))
    if stream.static or info is None or info.oldest_ns is None or info.newest_ns is None:
        return facts, []
    oldest, newest = info.oldest_ns / S, info.newest_ns / S
    facts.append(f"buffer {newest - oldest:.2f} s")
    return facts, [f"most recent transform: {newest:.6f}", f"oldest transform: {oldest:.6f}"]


def _add_tree_legend(dot: Any, time: float | None) -> None:
    title = "view_frames" if time is None else f"Recorded at time: {time:.3f}"
    with dot.subgraph(name="cluster_legend") as legend:
        legend.attr(label=title, labelloc="t", labeljust="c", color="#B0B0B0", style="rounded")
        legend.attr("node", shape="point", style="invis", width="0", label="")
        for kind, style in {**STYLES, "problem": PROBLEM}.items():
            legend.edge(
                f"#{kind} from", f"#{kind} to", _lines([kind, GROUND], "\\n"), **{**style, "class": "legend"}
            )


def _lines(texts: Any, end: str) -> str:
    """Make a label of texts, which end each line as Graphviz does: ``\\l`` aligns to the left."""
    from graphviz import escape, nohtml

    # Graphviz interprets entities as HTML does.
    lines = (str(escape(text)).replace("&", "&amp;") + end for text in texts)
    # Otherwise a label that begins with < and ends with > would be markup.
    marked: str = nohtml("".join(lines))
    return marked


# Shared by all pictures made with matplotlib.


DPI = 100
_SETTINGS: Any = {
    "text.parse_math": False,  # a name with two dollar signs is not a formula
    "svg.fonttype": "none",  # text stays text ...
    "pdf.fonttype": 42,  # ... that can be searched for
    "font.size": 9.0,
    "axes.unicode_minus": False,
    "date.autoformatter.minute": "%H:%M",
    "date.autoformatter.microsecond": "%H:%M:%S.%f",
}


@contextmanager
def style() -> Iterator[None]:
    """Set how figures look, during a ``with`` statement."""
    import matplotlib

    with matplotlib.rc_context(_SETTINGS), warnings.catch_warnings():
        # Characters that its fonts lack are shown as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def file_of(figure: Any, kind: str) -> bytes:
    """
    Get the contents of a file with a figure.

    :param kind: ``png``, ``svg`` or ``pdf``.
    """
    written = BytesIO()
    with style():
        figure.savefig(written, format=kind, dpi=DPI)
    return written.getvalue()


FIRST_DATE_S = 1e9  # in 2001; earlier times are simulated, because the clock of a simulation begins at 0
DAY_S = 86_400.0


def show_times(axes: Any, begin: float, end: float) -> None:
    """
    Label the x axis with the time of the clock: UTC, or the seconds of simulated time.

    :param begin: the left edge, in seconds since the epoch of the clock.
    :param end: the right edge, not before ``begin``.
    """
    if end == begin:
        begin, end = begin - 0.5, end + 0.5
    if begin < FIRST_DATE_S:
        axes.ticklabel_format(axis="x", style="plain", useOffset=False)
        axes.set_xlabel("time in s")
    else:
        import matplotlib.dates

        dates: Any = matplotlib.dates  # without types; its times are in days
        locator = dates.AutoDateLocator(minticks=3, maxticks=6)
        first, last = (datetime.fromtimestamp(time, timezone.utc) for time in (begin, end))
        ticks = locator.tick_values(first, last)
        formatter = dates.AutoDateFormatter(locator)
        axes.set_xticks(ticks * DAY_S, map(formatter, ticks))
        axes.set_xlabel(f"time in UTC, from {first:%Y-%m-%d %H:%M:%S} ({begin:.3f} s)")
    axes.set_xlim(begin, end)


# When transforms were received.


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
PLACES = 5000  # of the picture's width; one reception is drawn in each

GAP: Style = {"facecolor": VERMILION, "alpha": 0.3, "edgecolor": VERMILION, "hatch": "///"}
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


# For programs.


def refuse_plot(options: Namespace) -> None:
    """Raise a UsageError for frames together with a path, and an error if matplotlib is not installed."""
    if options.path is not None and options.frames:
        raise UsageError("expected frames or --path, got both")
    require("matplotlib", "plot")


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
        f"no valid transform of {name} was received" if name in frames else not_known(name, frames)
        for name in names
        if not own[name]
    ]
    if lacking:
        raise RunError("; ".join(lacking))
    chosen = [one for name in names for one in own[name]] if names else streams
    return heard_figure(heard_rows(records, chosen, frames), *span)


def write_plot(name: str, figure: Any) -> None:
    """Write a matplotlib figure in the format that the extension of the file means."""
    write_whole(name, file_of(figure, format_of(name)))


def drawn(dot: str, kind: str) -> bytes:
    """
    Draw what DOT describes.

    :param kind: ``svg``, ``png`` or ``pdf``.
    :raises RunError: Graphviz's program ``dot`` is not installed or failed.
    """
    import graphviz

    try:
        picture: bytes = graphviz.pipe("dot", kind, dot.encode(), quiet=True)
    except graphviz.ExecutableNotFound:
        advice = "install Graphviz, which has the program dot (Debian, Ubuntu: apt install graphviz)"
        raise RunError(f"no picture: {advice}; a file that ends in .gv does not need it") from None
    except graphviz.CalledProcessError as failure:
        said = (failure.stderr or b"").decode(errors="replace").strip()
        raise RunError(f"dot failed: {said or failure}") from None
    return picture
