# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Report problems with the transforms of a robot."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

from tf2_py.printable import counted
from tf2_ros_tools.common.options import add_live_option, positive_number
from tf2_ros_tools.common.output import span
from tf2_ros_tools.common.program import Parser, run
from tf2_ros_tools.diagnosis.check_options import add_check_options

if TYPE_CHECKING:
    from tf2_ros_tools.listening.session import Report
    from tf2_ros_tools.live.feed import Feed

PARSER = Parser(
    "tf2_check",
    "Listen to transforms for a while, and print a line for each problem: no transform at all, "
    "unconnected trees, loops, frames with two parents or two publishers, frames that are no longer "
    "published, gaps, late transforms, stamps from another clock or the future, and differences from a "
    "file of expectations.\n\n"
    "The documentation of tf2_check explains the kinds of problems.\n\n"
    "With --live, also log how many messages have arrived on each topic and how many were lost, publishers "
    "from which nothing has arrived, and by how much the clocks differ.\n\n"
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
        feed = heard.session.feed
        # Before the report: what arrives meanwhile must not seem to be missing from it.
        reception = {} if feed is None else _reception(feed, options.t)
        report = heard.report(limits, expected)
        for line in _lines(report, **reception) if reception else ():
            heard.session.info(line)
    of_what = f"{counted(report.messages, 'message')}, {options.t:g} s"
    return conclude(options, report, of_what, {"seconds": options.t, **reception})


def _reception(feed: Feed, seconds: float) -> dict[str, Any]:
    """Get what a feed knows besides the transforms, for JSON; it has listened for ``seconds``."""
    return {
        "topics": {name: asdict(one) for name, one in feed.topics.items()},
        "publishers": [one._asdict() for one in feed.publishers()],
        "clock_offset": feed.clock_offset,
        "silence": feed.why_silent(seconds) or None,
    }


def _lines(
    report: Report,
    topics: Mapping[str, Any],
    publishers: Sequence[Mapping[str, str]],
    clock_offset: float | None,
    silence: str | None,
) -> Iterator[str]:
    """Describe it in lines, without what the report says."""
    for topic, heard in topics.items():
        rate = "" if heard["rate"] is None else f", {heard['rate']:.1f} a second"
        lost = "" if heard["lost"] is None else f"{heard['lost']} lost, "
        yield f"{topic}: {counted(heard['count'], 'message')}{rate}; {lost}{heard['malformed']} malformed"
    quiet = {one["node"] for one in publishers if one["node"]} - {one.publisher for one in report.streams}
    yield from (f"{name}: nothing has arrived" for name in sorted(quiet))
    if clock_offset is not None:
        yield f"messages arrive at least {span(clock_offset)} after they were sent"
    if silence is not None and not any(one.kind in ("nothing", "qos") for one in report.findings):
        yield silence


main = partial(run, PARSER, check)

if __name__ == "__main__":
    sys.exit(main())
