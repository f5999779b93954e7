"""Owns the picture of frames and their parents."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from tf2_ros._pictures import labels
from tf2_ros._traffic.findings import Finding
from tf2_ros._traffic.streams import Stream

__all__ = ["render", "tree_dot"]

# Colours that all eyes tell apart (M. Okabe and K. Ito, 2008); the styles do without colour, too.
STYLES = {
    "dynamic": {"color": "#0072B2", "style": "solid", "penwidth": "1.6"},
    "static": {"color": "#6E6E6E", "style": "dashed", "penwidth": "1.2"},
    "stale": {"color": "#D55E00", "style": "dotted", "penwidth": "3"},
}
GROUND = " "  # the last line of an edge's label, for Graphviz draws the edge just below it
FONT = {"fontname": "Helvetica", "fontsize": "11"}
MOST_FINDINGS = 20
LONGEST_FINDING = 120  # characters


def tree_dot(
    streams: Sequence[Stream],
    findings: Sequence[Finding] = (),
    lengths: Mapping[str, float] = {},
    time: float | None = None,
) -> str:
    """
    Describe the tree in DOT: an edge for each stream, from the parent to the frame.

    :param streams: as ``Streams.report`` gives them.
    :param findings: what is wrong with them; it is written below, and stale frames have a style of their own.
    :param lengths: how long the history of each dynamic frame in a buffer is, in seconds.
    :param time: when this was so, in seconds of the clock of the streams.
    """
    import graphviz

    dot = graphviz.Digraph(
        "G",
        # From left to right, a robot of many links fits a page or a window.
        graph_attr={
            **FONT,
            "rankdir": "LR",
            "labelloc": "b",
            "labeljust": "l",
            "label": _lines(_below(findings), "\\l"),
        },
        node_attr={**FONT, "shape": "box", "style": "rounded,filled", "fillcolor": "#F4F6F8"},
        edge_attr={**FONT, "fontsize": "10", "arrowsize": "0.7"},
    )
    stale = {finding.frame for finding in findings if finding.kind == "stale"}
    names = sorted({name for stream in streams for name in (stream.frame, stream.parent)})
    # Not by their names: for Graphviz, a colon in one begins a port.
    ids = {name: f"frame{number}" for number, name in enumerate(names)}
    for name in names:
        text = _lines([labels.label(name)], "")
        dot.node(ids[name], text, tooltip=text, **{"class": "frame"})
    for stream in streams:
        kind = "static" if stream.static else "stale" if stream.frame in stale else "dynamic"
        text = _lines(_facts(stream, kind, lengths.get(stream.frame)), "\\n")
        dot.edge(ids[stream.parent], ids[stream.frame], text, tooltip=text, **STYLES[kind], **{"class": kind})
    if not streams:
        dot.node("nothing", "no transform was received", shape="plaintext", style="")
    _add_legend(dot, time)
    source: str = dot.source
    return source


def render(dot: str, kind: str) -> bytes:
    """
    Draw what DOT describes.

    :param kind: ``svg``, ``png`` or ``pdf``.
    :raises FileNotFoundError: Graphviz's program ``dot`` is not installed.
    :raises RuntimeError: it failed; the text is what it said.
    """
    import graphviz

    try:
        drawn: bytes = graphviz.pipe("dot", kind, dot.encode(), quiet=True)
    except graphviz.ExecutableNotFound as lack:
        raise FileNotFoundError(str(lack)) from None
    except graphviz.CalledProcessError as failure:
        said = (failure.stderr or b"").decode(errors="replace").strip()
        raise RuntimeError(said or str(failure)) from None
    return drawn


def _facts(stream: Stream, kind: str, length: float | None) -> Iterator[str]:
    yield labels.label(stream.publisher)
    yield labels.rate(stream)
    if stream.delay is not None:
        yield labels.delay(stream)
    if length is not None and not stream.static:
        yield f"buffer {length:.2f} s"
    if kind == "stale":
        yield f"stale for {max(stream.silence, stream.stalled):.1f} s"
    yield GROUND


def _below(findings: Sequence[Finding]) -> Iterator[str]:
    for finding in findings[:MOST_FINDINGS]:
        yield labels.label(finding.text, LONGEST_FINDING)
    if len(findings) > MOST_FINDINGS:
        yield f"and {len(findings) - MOST_FINDINGS} more"


def _add_legend(dot: Any, time: float | None) -> None:
    label = "view_frames" if time is None else f"Recorded at time: {time:.3f}"
    with dot.subgraph(name="cluster_legend") as legend:
        legend.attr(label=label, labelloc="t", labeljust="c", color="#B0B0B0", style="rounded")
        legend.attr("node", shape="point", style="invis", width="0", label="")
        for kind, style in STYLES.items():
            legend.edge(
                f"{kind}_from", f"{kind}_to", _lines([kind, GROUND], "\\n"), **style, **{"class": "legend"}
            )


def _lines(texts: Any, end: str) -> str:
    """Texts as a label, each line with an end of Graphviz's: ``\\l`` aligns to the left."""
    from graphviz import escape, nohtml

    # Graphviz reads entities as HTML does.
    lines = (str(escape(text)).replace("&", "&amp;") + end for text in texts)
    # Otherwise a label from < to > would be markup.
    label: str = nohtml("".join(lines))
    return label
