"""Owns the program that draws transforms over time."""

import sys

from tf2_ros_cython.cli.tf2_plot import main

if __name__ == "__main__":  # before what needs ROS: `main` says in one line what is missing
    sys.exit(main())

from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

import time
from argparse import Namespace

import numpy as np
from numpy.typing import NDArray
from rclpy.duration import Duration

from tf2_ros._times import FOR_EVER
from tf2_ros._traffic.findings import Limits
from tf2_ros._traffic.settling import Settling, replaced
from tf2_ros.cli._drawing import heard_picture, refuse_plot, way_picture, write_plot
from tf2_ros.cli._listening import listening
from tf2_ros.cli._node import spun_node
from tf2_ros_cython.cli._program import SUCCESS, RunError

__all__ = ["main", "plot"]

S = 1_000_000_000
LEAD_S = 1.5  # for the discovery of publishers; what they send in this time is not drawn


def plot(options: Namespace) -> int:
    """Listen and draw; return the exit status."""
    refuse_plot(options)
    kept: list[NDArray[np.void]] = []
    heard_s = options.t + LEAD_S
    cache_time = Duration(nanoseconds=round(min(2 * heard_s * S, FOR_EVER.nanoseconds)))
    with (
        spun_node("tf2_plot", options) as node,
        listening(node, options.t, cache_time=cache_time) as heard,
    ):
        node.get_logger().info(f"Listening to tf data for {heard_s:g} seconds...")
        heard.listen(heard_s, kept)
        records = np.concatenate(kept)
        records = records[~replaced(records, Settling().early(records))]
        if not len(records):
            raise RunError("no transform was received")
        report = heard.report(Limits())
        begin = report.time - options.t
        of_records = (records, report.streams, heard.frames())
        if options.path is None:
            figure = heard_picture(*of_records, options.frames, (begin, report.time))
        else:
            drawn = records[records["received_ns"] >= begin * S]
            figure = way_picture(heard.buffer, drawn, *of_records[1:], options.path)
    name = options.output or time.strftime("tf2_plot_%Y-%m-%d_%H.%M.%S.png")
    write_plot(name, figure)
    print(name)
    return SUCCESS
