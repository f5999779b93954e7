"""Owns the program that draws transforms over time."""

import sys
import time
from argparse import Namespace
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.duration import Duration

from tf2_py import TransformException
from tf2_ros._pictures.heard import Heard, heard_figure, heard_rows
from tf2_ros._pictures.plots import file_of
from tf2_ros._pictures.trajectory import trajectory_figure
from tf2_ros._times import FOR_EVER
from tf2_ros._traffic.chains import chain_between, moving_on, newest_streams
from tf2_ros._traffic.findings import Limits
from tf2_ros.cli._files import write_whole
from tf2_ros.cli._listening import Listening, listening
from tf2_ros.cli._node import spun_node
from tf2_ros.numpy import to_matrix
from tf2_ros_cython.cli._program import SUCCESS, RunError, UsageError
from tf2_ros_cython.cli._rpy import rpy_from_matrix
from tf2_ros_cython.cli.tf2_plot import main, picture_format

__all__ = ["main", "plot"]

S = 1_000_000_000
LEAD_S = 1.5  # for the discovery of publishers; what they send in this time is not drawn
MOST_TIMES = 5000  # of a way; a picture is not that wide

Records = NDArray[np.void]


def plot(options: Namespace) -> int:
    """Listen and draw; return the exit status."""
    if options.path is not None and options.frames:
        raise UsageError("frames or --path, not both")
    if find_spec("matplotlib") is None:
        raise RunError("pictures need the Python package matplotlib: pip install matplotlib")
    kept: list[Records] = []
    heard_s = options.t + LEAD_S
    cache_time = Duration(nanoseconds=round(min(2 * heard_s * S, FOR_EVER.nanoseconds)))
    with (
        spun_node("tf2_plot", options) as node,
        listening(node, options.t, cache_time=cache_time) as heard,
    ):
        node.get_logger().info(f"Listening to tf data for {heard_s:g} seconds...")
        heard.listen(heard_s, kept)
        records = np.concatenate(kept)
        if not len(records):
            raise RunError("no transform was received")
        if options.path is None:
            figure = _draw_heard(heard, records, options)
        else:
            figure = _draw_path(heard, records, options)
    name = options.output or time.strftime("tf2_plot_%Y-%m-%d_%H.%M.%S.png")
    write_whole(name, file_of(figure, picture_format(name)))
    print(name)
    return SUCCESS


def _draw_heard(heard: Listening, records: Records, options: Namespace) -> Any:
    report = heard.report(Limits())
    rows = heard_rows(records, report.streams, heard.frames(), Limits())
    wanted = [_name(one) for one in options.frames]
    if wanted:
        rows = [row for name in wanted for row in _rows_of(name, rows)]
    return heard_figure(rows, report.time - options.t, report.time)


def _rows_of(name: str, rows: list[Heard]) -> list[Heard]:
    nothing = np.zeros(0)
    return [row for row in rows if row.name == name] or [Heard(name, None, nothing, nothing, np.inf)]


def _draw_path(heard: Listening, records: Records, options: Namespace) -> Any:
    target, source = (_name(one) for one in options.path)
    report = heard.report(Limits())
    newest = newest_streams(report.streams)
    chain = chain_between(newest, target, source)
    if chain is None:
        raise RunError(f"{target} and {source} are not connected")
    numbers = {name: number for number, name in enumerate(heard.frames())}
    moving = [numbers[name] for name in moving_on(newest, chain)]
    begin_ns = (report.time - options.t) * S
    drawn = (
        np.isin(records["child"], moving) & (records["static"] == 0) & (records["received_ns"] >= begin_ns)
    )
    stamps = np.unique(records["stamp_ns"][drawn])
    if not len(stamps):
        raise RunError(f"between {target} and {source} nothing moves")
    stamps = stamps[np.unique(np.linspace(0, len(stamps) - 1, MOST_TIMES).astype(int))]
    try:
        positions, rotations = heard.buffer.lookup_transforms(target, source, stamps, on_missing="nan")
    except TransformException as reason:
        raise RunError(str(reason)) from None
    known = np.flatnonzero(~np.isnan(positions).any(axis=1))
    if not len(known):
        raise RunError(f"at no time all frames between {target} and {source} were known")
    shown = slice(known[0], known[-1] + 1)
    rpy = np.full_like(positions, np.nan)
    matrices = to_matrix((positions[known], rotations[known]))
    rpy[known] = [rpy_from_matrix(matrix) for matrix in matrices.tolist()]
    return trajectory_figure(target, source, stamps[shown] / S, positions[shown], rpy[shown])


def _name(frame: str) -> str:
    return frame.removeprefix("/")


if __name__ == "__main__":
    sys.exit(main())
