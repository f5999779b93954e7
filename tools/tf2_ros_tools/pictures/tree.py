# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Draw the tree of frames, with graphviz."""

import re
from collections.abc import Mapping, Sequence
from textwrap import wrap
from types import MappingProxyType
from typing import Any

from tf2_py import FrameInfo
from tf2_ros_tools.common.program import RunError
from tf2_ros_tools.diagnosis.findings import Finding
from tf2_ros_tools.diagnosis.stream_statistics import Stream
from tf2_ros_tools.diagnosis.texts import delay_label, rate_label
from tf2_ros_tools.pictures.style import BLUE, GREY, VERMILION, label

S = 1_000_000_000

# The styles also work without color.
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


def drawn(dot: str, kind: str, alternative: str = "") -> bytes:
    """
    Draw what DOT describes.

    :param kind: ``svg``, ``png`` or ``pdf``.
    :param alternative: to installing Graphviz, for the error.
    :raises RunError: Graphviz's program ``dot`` is not installed or failed.
    """
    import graphviz

    try:
        picture: bytes = graphviz.pipe("dot", kind, dot.encode(), quiet=True)
    except graphviz.ExecutableNotFound:
        advice = "install Graphviz, which has the program dot (Debian, Ubuntu: apt install graphviz)"
        raise RunError(f"no picture: {advice}{alternative}") from None
    except graphviz.CalledProcessError as failure:
        said = (failure.stderr or b"").decode(errors="replace").strip()
        raise RunError(f"dot failed: {said or failure}") from None
    return picture
