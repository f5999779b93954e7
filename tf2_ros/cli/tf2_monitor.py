"""Owns the program that shows who publishes which frame, how often, how late, and what is wrong."""

import sys

from tf2_ros_cython.cli.tf2_monitor import main

if __name__ == "__main__":  # before what needs ROS: `main` says in one line what is missing
    sys.exit(main())

from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

import json
import time
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from typing import Any

from tf2_py._internal import printable
from tf2_ros._traffic.findings import Limits
from tf2_ros._traffic.streams import Stream
from tf2_ros.cli._figures import milliseconds, rate, stream_line
from tf2_ros.cli._listening import Chain, Report, listening
from tf2_ros.cli._node import spun_node
from tf2_ros_cython.cli._program import SUCCESS, UsageError

__all__ = ["main", "monitor"]

LIVE_INTERVAL_S = 1.0
INTERVAL_S = 10.0  # as tf2's program
DRAWING_SHARE = 0.02  # of a core, for drawing the table; a large one is renewed less often ...
LONGEST_LIVE_S = 3.0  # ... but so often at least
TABLE_LINES = 6  # of its frame, its titles, what follows it, and the cursor

# Shows a report; the result is how many seconds should pass until the next one, at least.
Show = Callable[[Report], float]


def monitor(options: Namespace) -> int:
    """Report until interrupted; return the exit status."""
    ends = _ends(options.frames)
    live = not options.json and options.interval is None and _can_live()
    interval_s = options.interval or (LIVE_INTERVAL_S if live else INTERVAL_S)
    limits = Limits(min_rate=options.min_rate)
    output = _live() if live else _lines(_as_json if options.json else _as_text)
    with (
        suppress(KeyboardInterrupt),
        spun_node("tf2_monitor", options) as node,
        listening(node, options.window) as heard,
        output as show,
    ):
        due = time.monotonic() + interval_s
        while True:
            heard.listen(due - time.monotonic())
            at_least_s = show(heard.report(limits, ends=ends))
            due = max(due + max(interval_s, at_least_s), time.monotonic())
    return SUCCESS


def _ends(frames: list[str]) -> tuple[str, str] | None:
    if not frames:
        return None
    if len(frames) != 2:
        raise UsageError(f"two frames, or none, not {len(frames)}")
    a, b = (name.removeprefix("/") for name in frames)
    return a, b


def _can_live() -> bool:
    if not sys.stdout.isatty():
        return False
    try:
        from rich.console import Console
    except ModuleNotFoundError:
        return False
    return not Console().is_dumb_terminal  # which cannot draw over what it shows


# A report as lines.


@contextmanager
def _lines(lines_of: Callable[[Report], Iterator[str]]) -> Iterator[Show]:
    def show(report: Report) -> float:
        for line in lines_of(report):
            print(printable(line))
        return 0.0

    yield show


def _as_json(report: Report) -> Iterator[str]:
    yield json.dumps(asdict(report))


def _as_text(report: Report) -> Iterator[str]:
    yield f"at {report.time:.3f} s"
    for stream in _shown(report):
        yield f"  {stream_line(stream)}"
    if report.chain is not None:
        yield f"  {_chain_text(report.chain)}"
    for text in _warnings(report):
        yield f"  warning: {text}"


# A report as a table that stays.


@contextmanager
def _live() -> Iterator[Show]:
    from rich.live import Live

    # Without a thread that renews it: a report does. What is higher than the terminal is cut there.
    with Live(auto_refresh=False) as live:

        def show(report: Report) -> float:
            began = time.thread_time()
            live.update(_table(report, live.console.height), refresh=True)
            return min((time.thread_time() - began) / DRAWING_SHARE, LONGEST_LIVE_S)

        yield show


def _table(report: Report, height: int) -> Any:
    from rich.console import Group
    from rich.table import Table

    table = Table()
    for title in ("frame", "parent", "publisher"):
        table.add_column(title, overflow="fold")
    for title in ("Hz", "delay ms", "max ms", "jitter ms"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("wrong", overflow="fold")
    texts = _cut([*_warnings(report)], height // 3)
    above = [_words(text, style="red") for text in texts]
    if report.chain is not None:
        above.insert(0, _words(_chain_text(report.chain)))
    wrong: dict[str, list[str]] = {}
    for finding in report.findings:
        wrong.setdefault(finding.frame, []).append(finding.kind)
    streams = sorted(_shown(report), key=lambda one: one.frame not in wrong)
    fitting = max(1, height - len(above) - TABLE_LINES)
    for stream in streams[:fitting]:
        kinds = wrong.get(stream.frame, [])
        delays = (stream.delay, stream.delay_max, stream.jitter)
        table.add_row(
            _words(stream.frame),
            _words(stream.parent),
            _words(stream.publisher),
            "static" if stream.static else rate(stream),
            *("" if stream.static else milliseconds(delay) for delay in delays),
            ", ".join(kinds),
            style="red" if kinds else None,
        )
    more = len(streams) - fitting
    return Group(*above, table, _words(f"and {more} more" if more > 0 else ""))


def _words(text: str, style: str = "") -> Any:
    from rich.text import Text

    # Text, and not str: a name may look like markup.
    return Text(printable(text), style=style)


def _cut(texts: list[str], count: int) -> list[str]:
    if len(texts) <= count:
        return texts
    return [*texts[: count - 1], f"and {len(texts) - count + 1} more"]


# Parts of both.


def _shown(report: Report) -> list[Stream]:
    if report.chain is None or report.chain.frames is None:
        return report.streams
    return [stream for stream in report.streams if stream.frame in report.chain.frames]


def _warnings(report: Report) -> Iterator[str]:
    for finding in report.findings:
        yield finding.text
    if report.lost:
        yield f"{report.lost} transforms arrived too fast to be noted"
    if report.malformed:
        yield f"{report.malformed} messages could not be read"


def _chain_text(chain: Chain) -> str:
    if chain.frames is None:
        return f"{chain.ends[0]} and {chain.ends[1]} are not connected"
    text = " -> ".join(chain.frames)
    if chain.delay is None:
        return f"{text}: no net delay"
    mean, most = chain.delay
    return f"{text}: net delay {milliseconds(mean)} ms, max {milliseconds(most)} ms"
