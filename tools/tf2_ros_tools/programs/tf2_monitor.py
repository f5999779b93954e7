# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Show who publishes which frame, how often, how late, and what is wrong."""

from __future__ import annotations

import os
import shlex
import sys
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from importlib.util import find_spec
from math import nan
from typing import TYPE_CHECKING, NoReturn

from tf2_py import stored_name
from tf2_py.printable import counted
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.common.options import add_live_option, positive_number
from tf2_ros_tools.common.output import show, show_json
from tf2_ros_tools.common.pace import Pace
from tf2_ros_tools.common.program import EXIT_STATUS, SUCCESS, Parser, UsageError, run

if TYPE_CHECKING:
    from tf2_ros_tools.diagnosis.stream_statistics import Stream
    from tf2_ros_tools.listening.session import Listening, Report

INTERVAL_S = 10.0  # as in tf2's program
WINDOW_S = 10.0  # the figures are of this long before a report
LOOPBACK = "127.0.0.1"


def _address(text: str) -> tuple[str, int]:
    """For argparse: read a host and a port; without a host, browsers on other machines are not served."""
    host, _, port = text.rpartition(":")
    if not (port.isascii() and port.isdecimal() and 0 < int(port) < 1 << 16):
        raise ArgumentTypeError(f"expected a port from 1 to 65535, or HOST:PORT, got {text!r}")
    return host.removeprefix("[").removesuffix("]") or LOOPBACK, int(port)


PARSER = Parser(
    "tf2_monitor",
    "Show who publishes each frame, its rate and delay, and all problems, until interrupted. On a "
    "terminal, if the Python package textual is installed, this is a table, updated every second, that you "
    "can sort and filter. Otherwise, print a report like tf2's, every ten seconds.\n\n"
    "With two frames, show only the chain between them, and the age of its newest transform.\n\n"
    + EXIT_STATUS,
    "  tf2_monitor map base_link --interval 5",
)
PARSER.add_argument("frames", nargs="*", metavar="FRAME", help="two frames, to show the chain between them")
PARSER.add_argument(
    "--interval",
    type=positive_number,
    metavar="S",
    help="print a report every S seconds instead of the table",
)
PARSER.add_argument("--json", action="store_true", help="print each report as one line of JSON")
PARSER.add_argument(
    "--web",
    type=_address,
    metavar="[HOST:]PORT",
    help="serve the table to web browsers at http://HOST:PORT; without HOST, only to those on this machine",
)
add_live_option(PARSER)


def monitor(options: Namespace) -> int:
    """Report until interrupted; return the exit status."""
    from tf2_ros_tools.diagnosis.findings import Limits
    from tf2_ros_tools.listening.session_choice import listening

    ends = _ends(options.frames)
    if options.web is not None and not _is_in_browser():
        return _serve(options)
    with listening("tf2_monitor", options, WINDOW_S) as heard:

        def look() -> Report:
            heard.session.require_open()
            return heard.report(Limits(), ends=ends)

        if not options.json and options.interval is None and _has_screen():
            from tf2_ros_tools.pictures.monitor_screen import show_screen

            return show_screen(look, heard.buffer.frames, heard.session.where)
        _print_reports(heard, look, options)


def _serve(options: Namespace) -> int:
    if options.json or options.interval is not None:
        raise UsageError("--web cannot be combined with --json or --interval")
    require("textual_serve", "web")
    from tf2_ros_tools.listening.session_choice import listening
    from tf2_ros_tools.pictures.monitor_page import serve

    # A browser does not show the errors of the process that is started for it.
    with listening("tf2_monitor", options):
        pass
    host, port = options.web
    command = shlex.join(["exec", sys.executable, *sys.orig_argv[1:]])
    serve(host, port, command, title=shlex.join(["tf2_monitor", *options.frames]))
    return SUCCESS


def _print_reports(heard: Listening, look: Callable[[], Report], options: Namespace) -> NoReturn:
    interval_s = INTERVAL_S if options.interval is None else options.interval
    what = " -> ".join(options.frames) or "all frames"
    say = heard.session.info if options.json else show
    say(f"Gathering data on {what} for {counted(interval_s, 'second')}...")
    pace = Pace(interval_s)
    while True:
        heard.listen(pace.next_s())
        report = look()
        if options.json:
            show_json(asdict(report))
        else:
            show(*_as_of_tf2(report))


def _ends(frames: list[str]) -> tuple[str, str] | None:
    if not frames:
        return None
    if len(frames) != 2:
        raise UsageError(f"expected 0 or 2 frames, got {len(frames)}")
    a, b = map(stored_name, frames)
    return a, b


def _is_in_browser() -> bool:
    """Whether a server has started this process for a tab of a browser."""
    return os.environ.get("TEXTUAL_DRIVER", "").endswith(":WebDriver")


def _has_screen() -> bool:
    """Whether there is a browser, or a terminal that can be drawn on and a library that does it."""
    if _is_in_browser():
        return True
    is_terminal = sys.stdin.isatty() and sys.stdout.isatty()
    return is_terminal and os.environ.get("TERM", "dumb") != "dumb" and find_spec("textual") is not None


# A report as lines.


def _as_of_tf2(report: Report) -> Iterator[str]:
    """What tf2's program prints, for scripts that read it; after that, the problems."""
    chain = report.chain
    yield from ("", "", "")
    if chain is None:
        yield "RESULTS: for all Frames"
    else:
        yield f"RESULTS: for {chain.ends[0]} to {chain.ends[1]}"
        if chain.frames is None:
            yield chain.text
        else:
            mean, most = chain.delay or (nan, nan)
            yield f"Chain is: {' -> '.join(chain.frames)}"
            yield f"Net delay     avg = {mean:g}: max = {most:g}"
    yield from ("", "Frames:")
    by_node: dict[str, list[Stream]] = {}
    for one in report.streams:
        yield f"Frame: {one.frame}, published by {one.publisher}, {_delays([one], ', ')}"
    for one in report.streams:
        by_node.setdefault(one.publisher, []).append(one)
    yield from ("", "All Broadcasters:")
    for node, streams in sorted(by_node.items()):
        rate = max((one.rate for one in streams if one.rate is not None and not one.static), default=nan)
        yield f"Node: {node} {rate:g} Hz, {_delays(streams, ' ')}"
    if report.findings:
        yield from ("", "Problems:", *(one.text for one in report.findings))


def _delays(streams: Sequence[Stream], separator: str) -> str:
    timed = [(one.delay, one.delay_max, one.count) for one in streams if one.delay is not None]
    mean = (
        sum(delay * count for delay, _, count in timed) / sum(count for *_, count in timed) if timed else nan
    )
    most = max((most for _, most, _ in timed if most is not None), default=nan)
    return f"Average Delay: {mean:g}{separator}Max Delay: {most:g}"


main = partial(run, PARSER, monitor, interrupted=SUCCESS)

if __name__ == "__main__":
    sys.exit(main())
