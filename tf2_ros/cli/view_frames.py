"""Owns the program that draws the tree of frames."""

import sys

from tf2_ros_cython.cli.view_frames import WAIT_S, WATCH_S, main, output_files

if __name__ == "__main__":  # before what needs ROS: `main` says in one line what is missing
    sys.exit(main())

from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

import time
from argparse import Namespace
from collections.abc import Sequence
from contextlib import suppress

from tf2_ros._traffic.findings import Limits
from tf2_ros.cli._drawing import NO_DOT, dot_of, drawn, needs_graphviz
from tf2_ros.cli._files import write_whole
from tf2_ros.cli._listening import Listening, listening
from tf2_ros.cli._node import spun_node
from tf2_ros_cython.cli._program import FAILURE, SUCCESS

__all__ = ["main", "view"]

WATCH_WINDOW_S = 10.0  # of the figures
IDLE_SHARE = 4.0  # watching, at least so many times as long as drawing takes


def view(options: Namespace) -> int:
    """Listen and draw, as the options say; return the exit status."""
    draws = options.output is not None or not options.text
    if draws:
        needs_graphviz("--text")
    return _watch(options) if options.watch else _view_once(options, draws)


def _view_once(options: Namespace, draws: bool) -> int:
    wait_s = WAIT_S if options.wait_time is None else options.wait_time
    with (
        spun_node("view_frames", options) as node,
        listening(node, topics=(options.tf_topic, options.tf_static_topic)) as heard,
    ):
        node.get_logger().info(f"Listening to tf data for {wait_s:g} seconds...")
        heard.listen(wait_s)
        text = heard.buffer.tree()
        dot = _dot(heard) if draws else ""
        if not heard.frames():
            _tell_silence(heard.topics, wait_s)
    if options.text:
        print(text)
    if not draws:
        return SUCCESS
    files = output_files(options, time.strftime("%Y-%m-%d_%H.%M.%S"))
    try:
        _write(dot, *files)
    except FileNotFoundError:
        if not options.text:
            print(text)
        _tell_lack(files[0])
        return FAILURE
    for name in files[:2]:
        print(name)
    return SUCCESS


def _watch(options: Namespace) -> int:
    wait_s = WATCH_S if options.wait_time is None else options.wait_time
    files = output_files(options, "")
    told = False
    with (
        suppress(KeyboardInterrupt),
        spun_node("view_frames", options) as node,
        listening(node, WATCH_WINDOW_S, topics=(options.tf_topic, options.tf_static_topic)) as heard,
    ):
        took = 0.0
        while True:
            heard.listen(max(wait_s, IDLE_SHARE * took))
            begin = time.monotonic()
            try:
                _write(_dot(heard), *files)
            except FileNotFoundError:
                print(heard.buffer.tree())
                _tell_lack(files[0])
                return FAILURE
            took = time.monotonic() - begin
            if not told:
                told = True
                for name in files[:2]:
                    print(name)
    return SUCCESS


def _dot(heard: Listening) -> str:
    report = heard.report(Limits())
    return dot_of(heard.buffer, report.streams, report.findings, report.time)


def _write(dot: str, description: str, picture: str, kind: str) -> None:
    """
    Write both files.

    :raises FileNotFoundError: the first is written, and there is no program that draws the second.
    """
    write_whole(description, dot.encode())
    write_whole(picture, drawn(dot, kind))


def _tell_silence(topics: Sequence[str], wait_s: float) -> None:
    where = " and ".join(topics)
    text = f"no transform was received on {where} in {wait_s:g} s"
    cure = "publishers may take seconds to be found, so a longer -t may help"
    print(f"view_frames: {text}; {cure}", file=sys.stderr)


def _tell_lack(description: str) -> None:
    print(f"view_frames: no picture, only {description}: {NO_DOT}", file=sys.stderr)
