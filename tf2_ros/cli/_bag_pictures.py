"""Owns the commands of tf2_bag that draw, or have drawn, what is in a recording."""

import os
from argparse import Namespace

from tf2_ros._recordings.report import report
from tf2_ros.cli._bag_reading import heard_of
from tf2_ros.cli._drawing import (
    NO_DOT,
    dot_of,
    drawn,
    heard_picture,
    needs_graphviz,
    refuse_plot,
    way_picture,
    write_plot,
)
from tf2_ros.cli._files import write_whole
from tf2_ros_cython.cli._endings import format_of
from tf2_ros_cython.cli._program import SUCCESS, RunError

__all__ = ["plot", "tree", "view"]

S = 1_000_000_000
SHORTEST_S = 1.0  # of a picture; one message has no length


def tree(options: Namespace) -> int:
    """Print the tree of frames, or draw it; return the exit status."""
    if options.output is not None:
        needs_graphviz("the tree as text")
    heard = heard_of(options)
    if options.output is None:
        print(heard.buffer.tree())
        return SUCCESS
    said = report(heard)
    dot, kind = dot_of(heard.buffer, said.streams, said.findings, said.end), format_of(options.output)
    try:
        write_whole(options.output, dot.encode() if kind == "gv" else drawn(dot, kind))
    except FileNotFoundError:
        raise RunError(f"no picture: {NO_DOT}; one that ends in .gv needs none") from None
    print(options.output)
    return SUCCESS


def plot(options: Namespace) -> int:
    """Draw frames over time, or a way; return the exit status."""
    refuse_plot(options)
    heard = heard_of(options)
    said = report(heard)
    if said.begin is None or said.end is None:
        raise RunError(f"{options.file} has no transform")
    if options.path is None:
        # Static transforms are read whole, whatever --start and --end say.
        begin = said.begin if options.start is None else max(said.begin, options.start / S)
        end = said.end if options.end is None else min(said.end, options.end / S)
        span = (min(begin, end - SHORTEST_S), end)
        figure = heard_picture(heard.records, said.streams, heard.frames, options.frames, span)
    else:
        figure = way_picture(heard.buffer, heard.records, said.streams, heard.frames, options.path)
    name = options.output or f"{_stem(options.file)}.png"
    write_plot(name, figure)
    print(name)
    return SUCCESS


def view(options: Namespace) -> int:
    """Open the recording in rerun, or write one of rerun's; return the exit status."""
    from tf2_ros import rerun

    heard = heard_of(options)
    if options.output is not None:
        try:
            rerun.save(heard.buffer, options.output)
        except OSError as failure:
            raise RunError(f"cannot write {options.output}: {failure.strerror}") from None
        print(options.output)
        return SUCCESS
    try:
        rerun.view(heard.buffer)
    except rerun.ViewerError as failure:
        raise RunError(str(failure)) from None
    return SUCCESS


def _stem(path: str) -> str:
    return os.path.splitext(os.path.basename(os.path.abspath(path)))[0]
