# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Plot when transforms were received, or the path of a frame."""

import sys
import time
from argparse import Namespace
from functools import partial

from tf2_py.printable import counted
from tf2_ros_tools.common.options import add_live_option, add_plot_options, positive_number, refuse_plot
from tf2_ros_tools.common.output import show
from tf2_ros_tools.common.program import SUCCESS, Parser, RunError, run

S = 1_000_000_000

LEAD_S = 1.5  # for the discovery of publishers by a node; what they send during this time is not drawn
SECONDS = 10.0

DESCRIPTION = """\
Listen to transforms for a while, plot when each frame was received, with gaps, rates and delays, and print \
the name of the file. With --path, plot the path of a frame in another frame, from above and as components \
over time.

Exit status: 0 if the picture was written; 1 if it could not be written, or no transform was received; \
2 after wrong usage."""

EXAMPLE = """\
  tf2_plot                                 all frames, as tf2_plot_DATE.png
  tf2_plot odom base_link -t 30            two frames over 30 seconds
  tf2_plot --path map base_link -o path.svg"""


PARSER = Parser("tf2_plot", DESCRIPTION, EXAMPLE)
add_plot_options(PARSER, "tf2_plot_DATE.png")
PARSER.add_argument(
    "-t",
    type=positive_number,
    metavar="S",
    default=SECONDS,
    help=f"plot the last S seconds, after the time for discovery; {SECONDS:g} by default",
)
add_live_option(PARSER)


def plot(options: Namespace) -> int:
    """Listen and plot; return the exit status."""
    from tf2_ros_tools.diagnosis.findings import Limits
    from tf2_ros_tools.listening.session_choice import listening
    from tf2_ros_tools.live.transport import DISCOVERY_S
    from tf2_ros_tools.pictures.path import path_picture
    from tf2_ros_tools.pictures.reception_times import heard_picture
    from tf2_ros_tools.pictures.style import write_plot

    refuse_plot(options)
    heard_s = options.t + (LEAD_S if options.live is None else DISCOVERY_S)
    with listening("tf2_plot", options, options.t, cache_time=2 * heard_s) as heard:
        heard.session.info(f"Listening to tf data for {counted(heard_s, 'second')}...")
        heard.listen(heard_s)
        records = heard.records()
        if not len(records):
            raise RunError(f"no transform was received {heard.session.where}")
        report = heard.report(Limits())
        begin = report.time - options.t
        of_records = (records, report.streams, heard.frames())
        if options.path is None:
            figure = heard_picture(*of_records, options.frames, (begin, report.time))
        else:
            drawn = records[records["received_ns"] >= begin * S]
            figure = path_picture(heard.buffer, drawn, *of_records[1:], options.path)
    name = options.output or time.strftime("tf2_plot_%Y-%m-%d_%H.%M.%S.png")
    write_plot(name, figure)
    show(name)
    return SUCCESS


main = partial(run, PARSER, plot)

if __name__ == "__main__":
    sys.exit(main())
