# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Draw the tree of frames."""

import sys
import time
from argparse import Namespace
from functools import partial
from os.path import splitext

from tf2_py.printable import counted
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.common.options import add_live_option, format_of, non_negative_number
from tf2_ros_tools.common.output import show, write_whole
from tf2_ros_tools.common.program import SUCCESS, Parser, RunError, run

FORMATS = ("pdf", "svg", "png")
WAIT_S = 5.0

DESCRIPTION = """\
Listen to transforms for a while, draw the frames with their publishers, rates, delays and problems, and \
print the names of the files: NAME.pdf, and NAME.gv for Graphviz.

Exit status: 0 if the tree was drawn or printed; 1 if no transform was received, or the picture cannot be \
drawn or written; 2 after wrong usage."""

EXAMPLE = """\
  view_frames                     frames_DATE.gv and frames_DATE.pdf
  view_frames -t 10 -o robot.svg  robot.gv and robot.svg, after ten seconds
  view_frames --text              the tree in the terminal"""


PARSER = Parser("view_frames", DESCRIPTION, EXAMPLE)
PARSER.add_argument(
    "-t",
    "--wait-time",
    type=non_negative_number,
    metavar="S",
    default=WAIT_S,
    help=f"listen for S seconds, {WAIT_S:g} by default",
)
PARSER.add_argument(
    "-o",
    "--output",
    metavar="NAME",
    help="write NAME.gv and NAME.pdf; if NAME ends in .pdf, .svg or .png, write that picture; by default "
    "frames_DATE, with the current date and time",
)
PARSER.add_argument("--text", action="store_true", help="print the tree; write files only with -o")
PARSER.add_argument(
    "--tf_topic", metavar="TOPIC", default="/tf", help="the topic of dynamic transforms; /tf by default"
)
PARSER.add_argument(
    "--tf_static_topic",
    metavar="TOPIC",
    default="/tf_static",
    help="the topic of static transforms; /tf_static by default",
)


add_live_option(PARSER)


def output_files(name: str) -> tuple[str, str, str]:
    """Return the file for Graphviz, the picture, and the picture's format."""
    if format_of(name) in FORMATS:
        return f"{splitext(name)[0]}.gv", name, format_of(name)
    return f"{name}.gv", f"{name}.pdf", "pdf"


def view(options: Namespace) -> int:
    """Listen, and print or draw the tree; return the exit status."""
    from tf2_ros_tools.diagnosis.findings import Limits
    from tf2_ros_tools.diagnosis.texts import line_of
    from tf2_ros_tools.listening.session_choice import listening
    from tf2_ros_tools.pictures.tree import drawn, tree_dot

    is_drawn = options.output is not None or not options.text
    if is_drawn:
        require("graphviz", "cli")
    topics = (options.tf_topic, options.tf_static_topic)
    with listening("view_frames", options, topics=topics) as heard:
        heard.session.info(f"Listening to tf data for {counted(options.wait_time, 'second')}...")
        heard.listen(options.wait_time)
        report = heard.report(Limits())
        if not heard.frames():
            advice = "publishers may take seconds to be found, so a longer -t may help"
            raise RunError(f"no transform was received {heard.session.where}; {advice}")
        if options.text:
            found = [line_of(one) for one in report.findings]
            show(*heard.buffer.tree().splitlines(), *(["", *found] if found else []))
        infos = heard.buffer.frames()
    if is_drawn:
        dot = tree_dot(report.streams, report.findings, infos, report.time)
        name = options.output or time.strftime("frames_%Y-%m-%d_%H.%M.%S")
        description, picture, kind = output_files(name)
        write_whole(description, dot.encode())
        show(description)
        write_whole(picture, drawn(dot, kind))
        show(picture)
    return SUCCESS


main = partial(run, PARSER, view)

if __name__ == "__main__":
    sys.exit(main())
