"""Owns the pictures of programs: of what was heard, of a way, and of the tree of frames."""

from argparse import Namespace
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tf2_py import BufferCore, FrameInfo, TransformException
from tf2_ros._pictures import tree
from tf2_ros._pictures.heard import Heard, heard_figure, heard_rows
from tf2_ros._pictures.plots import file_of
from tf2_ros._pictures.trajectory import trajectory_figure
from tf2_ros._recordings.tables import look_up
from tf2_ros._traffic.chains import chain_between, newest_streams, stamps_on
from tf2_ros._traffic.findings import Finding, Limits
from tf2_ros._traffic.streams import Stream, taken
from tf2_ros.cli._files import write_whole
from tf2_ros.numpy import to_matrix
from tf2_ros_cython.cli._endings import format_of
from tf2_ros_cython.cli._program import RunError, UsageError
from tf2_ros_cython.cli._rpy import rpy_from_matrix

__all__ = [
    "NO_DOT",
    "dot_of",
    "drawn",
    "heard_picture",
    "needs_graphviz",
    "refuse_plot",
    "way_picture",
    "write_plot",
]

S = 1_000_000_000
NO_DOT = "install Graphviz, which has the program dot (Debian, Ubuntu: apt install graphviz)"
MOST_TIMES = 5000  # of a way; a picture is not that wide

Records = NDArray[np.void]


def refuse_plot(options: Namespace) -> None:
    """Raise a UsageError for both frames and a way, and a RunError where matplotlib is not installed."""
    if options.path is not None and options.frames:
        raise UsageError("frames or --path, not both")
    if find_spec("matplotlib") is None:
        raise RunError("pictures need the Python package matplotlib: pip install matplotlib")


def needs_graphviz(without: str) -> None:
    """
    Raise a RunError where the Python package is not installed.

    :param without: what needs none.
    """
    if find_spec("graphviz") is None:
        raise RunError(f"pictures need the Python package graphviz: pip install graphviz; {without} does not")


def heard_picture(
    records: Records,
    streams: Sequence[Stream],
    frames: Sequence[str],
    wanted: Sequence[str],
    span: tuple[float, float],
) -> Any:
    """
    Draw when transforms were received, as a figure of matplotlib's.

    :param frames: names, by the ids in the records.
    :param wanted: the names of the frames that are drawn, in this order; none: all.
    :param span: from when to when, in seconds.
    :raises RunError: nothing was received of those that are wanted.
    """
    rows = heard_rows(records, streams, frames, Limits())
    if wanted:
        if not {row.name for row in rows}.intersection(map(_name, wanted)):
            raise RunError(_lack(records, frames, list(map(_name, wanted))))
        rows = [row for name in wanted for row in _rows_of(_name(name), rows)]
    return heard_figure(rows, *span)


def way_picture(
    buffer: BufferCore,
    records: Records,
    streams: Sequence[Stream],
    frames: Sequence[str],
    ends: tuple[str, str],
) -> Any:
    """
    Draw the way of a frame in another one, at the stamps of the records, as a figure of matplotlib's.

    :param frames: names, by the ids in the records.
    :param ends: the frame in which it is seen, and the frame whose way it is.
    :raises RunError: there is none.
    """
    target, source = map(_name, ends)
    newest = newest_streams(streams)
    chain = chain_between(newest, target, source)
    if chain is None:
        raise RunError(f"{target} and {source} are not connected")
    stamps = stamps_on(records, frames, newest, chain)
    if not len(stamps):
        raise RunError(f"between {target} and {source} nothing moves")
    stamps = stamps[np.unique(np.linspace(0, len(stamps) - 1, MOST_TIMES).astype(int))]
    try:
        way = look_up(buffer, target, source, stamps).from_first_to_last_answer()
    except TransformException as reason:
        raise RunError(str(reason)) from None
    if not len(way):
        raise RunError(f"at no time all frames between {target} and {source} were known")
    rpy = np.full_like(way.translations, np.nan)
    matrices = to_matrix((way.translations[way.valid], way.rotations[way.valid]))
    rpy[way.valid] = [rpy_from_matrix(matrix) for matrix in matrices.tolist()]
    return trajectory_figure(target, source, way.stamps_ns / S, way.translations, rpy)


def write_plot(name: str, figure: Any) -> None:
    """Write a figure of matplotlib's in the format that the file's name says."""
    write_whole(name, file_of(figure, format_of(name)))


def dot_of(
    buffer: BufferCore, streams: Sequence[Stream], findings: Sequence[Finding], time: float | None
) -> str:
    """
    Describe the tree of frames in DOT.

    :param time: when it was so, in seconds; None: that is unknown.
    """
    lengths = {name: _length(info) for name, info in buffer.frames().items() if not info.static}
    return tree.tree_dot(streams, findings, lengths, time)


def drawn(dot: str, kind: str) -> bytes:
    """
    Draw what DOT describes.

    :param kind: ``svg``, ``png`` or ``pdf``.
    :raises FileNotFoundError: there is no program that does it.
    :raises RunError: it failed.
    """
    try:
        return tree.render(dot, kind)
    except RuntimeError as failure:
        raise RunError(f"dot failed: {failure}") from None


def _lack(records: Records, frames: Sequence[str], wanted: Sequence[str]) -> str:
    received, drawable = ({*some["child"].tolist()} for some in (records, taken(records)))
    only_refused = {frames[child] for child in received - drawable}
    refused = [name for name in wanted if name in only_refused]
    if refused:
        return f"all transforms of {' and '.join(refused)} are refused"
    return f"no transform of {' and '.join(wanted)} was received"


def _rows_of(name: str, rows: list[Heard]) -> list[Heard]:
    nothing = np.zeros(0)
    return [row for row in rows if row.name == name] or [Heard(name, None, nothing, nothing, np.inf)]


def _length(info: FrameInfo) -> float:
    if info.oldest_ns is None or info.newest_ns is None:
        return 0.0
    return (info.newest_ns - info.oldest_ns) / S


def _name(frame: str) -> str:
    return frame.removeprefix("/")
