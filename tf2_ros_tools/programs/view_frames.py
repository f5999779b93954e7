# PYTHON_ARGCOMPLETE_OK
"""Draw the tree of frames."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from contextlib import suppress
from os.path import splitext
from typing import TYPE_CHECKING

from tf2_ros_tools.output import seconds
from tf2_ros_tools.program import (
    FAILURE,
    SUCCESS,
    Parser,
    format_of,
    non_negative_number,
    run,
    write_output,
)

if TYPE_CHECKING:
    from rclpy.node import Node

    from tf2_ros_tools.listening import Listening

__all__ = ["main", "output_files"]

WATCH_WINDOW_S = 10.0  # which the figures cover
IDLE_SHARE = 4.0  # with --watch, the time between two pictures, in times that drawing one takes

FORMATS = ("pdf", "svg", "png")
WAIT_S = 5.0
WATCH_S = 1.0

DESCRIPTION = """\
Listen to transforms for a while, draw the tree of frames with publishers, rates, delays and problems as \
NAME.gv, for Graphviz, and as NAME.pdf, and print the names of both files.

Exit status: 0 if the files were written, otherwise 1."""

EXAMPLE = """\
  view_frames                     frames_DATE.gv and frames_DATE.pdf
  view_frames -t 10 -o robot.svg  robot.gv and robot.svg, after ten seconds
  view_frames --watch             frames.svg, updated every second
  view_frames --text              the tree in the terminal"""


def parser() -> Parser:
    """Its command line."""
    made = Parser("view_frames", DESCRIPTION, EXAMPLE)
    made.add_argument(
        "-t",
        "--wait-time",
        type=non_negative_number,
        metavar="S",
        help=f"listen for S seconds, {WAIT_S:g} by default; with --watch, {WATCH_S:g} before each picture",
    )
    made.add_argument(
        "-o",
        "--output",
        metavar="NAME",
        help="write NAME.gv and NAME.pdf; if NAME ends in .pdf, .svg or .png, write that picture",
    )
    how = made.add_mutually_exclusive_group()
    how.add_argument(
        "--watch", action="store_true", help="update the picture, an .svg by default, until interrupted"
    )
    how.add_argument("--text", action="store_true", help="print the tree; write files only if -o names them")
    made.add_argument("--tf_topic", metavar="TOPIC", default="/tf", help="the topic of dynamic transforms")
    made.add_argument(
        "--tf_static_topic", metavar="TOPIC", default="/tf_static", help="the topic of static transforms"
    )
    return made


def output_files(options: Namespace, date: str) -> tuple[str, str, str]:
    """
    Return the file for Graphviz, the picture, and the picture's format.

    :param date: for the default name.
    """
    name = options.output
    if name is None:
        name = "frames" if options.watch else f"frames_{date}"
    if format_of(name) in FORMATS:
        return f"{splitext(name)[0]}.gv", name, format_of(name)
    kind = "svg" if options.watch else "pdf"
    return f"{name}.gv", f"{name}.{kind}", kind


def view(options: Namespace) -> int:
    """Listen and draw, as the options say; return the exit status."""
    from tf2_ros_tools.listening import listening, spun_node

    # isort: split
    from tf2_ros_tools.pictures import needs_graphviz

    if options.output is not None or not options.text:
        needs_graphviz("--text")
    topics = (options.tf_topic, options.tf_static_topic)
    window_s = WATCH_WINDOW_S if options.watch else None
    with spun_node("view_frames", options) as node, listening(node, window_s, topics=topics) as heard:
        if not options.watch:
            return _view_once(node, heard, options)
        with suppress(KeyboardInterrupt):
            return _watch(heard, options)
    return SUCCESS


def _view_once(node: Node, heard: Listening, options: Namespace) -> int:
    wait_s = WAIT_S if options.wait_time is None else options.wait_time
    node.get_logger().info(f"Listening to tf data for {seconds(wait_s)}...")
    heard.listen(wait_s)
    if not heard.frames():
        text = f"no transform was received {heard.where}, in {wait_s:g} s"
        advice = "publishers may take seconds to be found, so a longer -t may help"
        print(f"view_frames: {text}; {advice}", file=sys.stderr)
    if options.text:
        print(_text(heard))
        if options.output is None:
            return SUCCESS
    files = output_files(options, time.strftime("%Y-%m-%d_%H.%M.%S"))
    if not _draw(heard, *files):
        if not options.text:
            print(_text(heard))
        return FAILURE
    for name in files[:2]:
        print(name)
    return SUCCESS


def _watch(heard: Listening, options: Namespace) -> int:
    wait_s = WATCH_S if options.wait_time is None else options.wait_time
    files = output_files(options, "")
    names, took = [*files[:2]], 0.0
    while True:
        heard.listen(max(wait_s, IDLE_SHARE * took))
        begin = time.monotonic()
        if not _draw(heard, *files):
            print(_text(heard))
            return FAILURE
        took = time.monotonic() - begin
        while names:
            print(names.pop(0))


def _text(heard: Listening) -> str:
    """The tree, and below it what is wrong; of no frames, only that there are none."""
    from tf2_ros_tools.findings import Limits, line_of

    text: str = heard.buffer.tree()
    found = heard.report(Limits()).findings if heard.frames() else []
    return "\n".join([text, "", *map(line_of, found)]) if found else text


def _draw(heard: Listening, description: str, picture: str, kind: str) -> bool:
    """Write both files; False: only the first, because Graphviz's program is not installed."""
    from tf2_ros_tools.findings import Limits
    from tf2_ros_tools.pictures import NO_DOT, drawn, tree_dot

    report = heard.report(Limits())
    dot = tree_dot(report.streams, report.findings, heard.buffer.frames(), report.time)
    write_output(description, dot.encode())
    try:
        write_output(picture, drawn(dot, kind))
    except FileNotFoundError:
        print(f"view_frames: no picture, only {description}: {NO_DOT}", file=sys.stderr)
        return False
    return True


def main(args: list[str] | None = None) -> int:
    """Run the program; see :func:`tf2_ros_tools.program.run`."""
    return run(parser(), view, args)


if __name__ == "__main__":
    sys.exit(main())
