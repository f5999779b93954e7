# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Report problems with the transforms of a robot."""

import sys
from argparse import Namespace
from functools import partial

from tf2_ros_tools.common.options import add_live_option, positive_number
from tf2_ros_tools.common.output import counted
from tf2_ros_tools.common.program import Parser, run
from tf2_ros_tools.diagnosis.check_options import add_check_options

PARSER = Parser(
    "tf2_check",
    "Listen to transforms for a while, and print a line for each problem: no transform at all, "
    "unconnected trees, loops, frames with two parents or two publishers, frames that are no longer "
    "published, gaps, late transforms, stamps from another clock or the future, and differences from a "
    "file of expectations.\n\n"
    "The documentation of tf2_check explains the kinds of problems.\n\n"
    "Exit status: 0 if there are no problems; 1 if there are any or the check failed; 2 after wrong usage.",
    """\
  tf2_check -t 10 --expect robot.yaml

robot.yaml, in which every entry is optional:
  frames:
    odom: {parent: map, max_future: 1.0}
    base_link: {parent: odom, min_rate: 20, max_delay: 0.1, static: false}""",
)
PARSER.add_argument(
    "-t",
    type=positive_number,
    metavar="S",
    default=5.0,
    help="listen for S seconds, 5 by default; if S is smaller, undiscovered publishers may look like "
    "problems",
)
add_check_options(PARSER)
PARSER.add_argument("--json", action="store_true", help="print the result as one line of JSON")
add_live_option(PARSER)


def check(options: Namespace) -> int:
    """Listen, print the problems, and return the exit status."""
    from tf2_ros_tools.diagnosis.findings import Limits, expected_by
    from tf2_ros_tools.diagnosis.texts import conclude
    from tf2_ros_tools.listening.session_choice import listening

    expected = expected_by(options.expect)
    limits = Limits(min_rate=options.min_rate, max_delay=options.max_delay)
    with listening("tf2_check", options) as heard:
        heard.session.log_no_refusals()  # the findings count them, with the publishers
        heard.session.info(f"Listening {heard.session.where} for {options.t:g} s...")
        heard.listen(options.t)
        report = heard.report(limits, expected)
    of_what = f"{counted(report.messages, 'message')}, {options.t:g} s"
    return conclude(options, report, of_what, {"seconds": options.t})


main = partial(run, PARSER, check)

if __name__ == "__main__":
    sys.exit(main())
