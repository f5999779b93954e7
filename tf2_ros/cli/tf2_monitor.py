"""Owns the program that shows who publishes which frame, how often, how late, and what is wrong."""

import json
import sys
import threading
import time
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from typing import Any

from tf2_ros._traffic.findings import Limits
from tf2_ros._traffic.streams import Stream
from tf2_ros.cli._listening import Chain, Listening, Report, listening
from tf2_ros.cli._node import spun_node
from tf2_ros_cython.cli._program import SUCCESS, UsageError
from tf2_ros_cython.cli.tf2_monitor import main

__all__ = ["main", "monitor"]

DRAIN_S = 1.0  # at least so often, whatever the interval
LIVE_INTERVAL_S = 1.0
INTERVAL_S = 10.0  # as tf2's program

Show = Callable[[Report], None]


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
        due = time.monotonic()
        while True:
            due = max(due + interval_s, time.monotonic())
            _drain_until(heard, due)
            show(heard.report(limits, ends=ends))
    return SUCCESS


def _ends(frames: list[str]) -> tuple[str, str] | None:
    if not frames:
        return None
    if len(frames) != 2:
        raise UsageError(f"two frames, or none, not {len(frames)}")
    a, b = (name.removeprefix("/") for name in frames)
    return a, b


def _drain_until(heard: Listening, due: float) -> None:
    while (left := due - time.monotonic()) > DRAIN_S:
        threading.Event().wait(min(left, DRAIN_S))
        heard.drain()
    threading.Event().wait(max(0.0, left))


def _can_live() -> bool:
    if not sys.stdout.isatty():
        return False
    try:
        import rich  # noqa: F401
    except ModuleNotFoundError:
        return False
    return True


# A report as lines.


@contextmanager
def _lines(lines_of: Callable[[Report], Iterator[str]]) -> Iterator[Show]:
    def show(report: Report) -> None:
        for line in lines_of(report):
            print(line)

    yield show


def _as_json(report: Report) -> Iterator[str]:
    yield json.dumps(asdict(report))


def _as_text(report: Report) -> Iterator[str]:
    yield f"at {report.time:.3f} s"
    for stream in _shown(report):
        parts = [f"parent {stream.parent}", f"publisher {stream.publisher}", *_figures(stream)]
        yield f"  {stream.frame}: {', '.join(parts)}"
    if report.chain is not None:
        yield f"  {_chain_text(report.chain)}"
    for text in _warnings(report):
        yield f"  warning: {text}"


def _figures(stream: Stream) -> Iterator[str]:
    if stream.static:
        yield "static"
        return
    yield f"{_rate(stream)} Hz"
    if stream.delay is not None:
        mean, most, jitter = (_ms(value) for value in (stream.delay, stream.delay_max, stream.jitter))
        yield f"delay {mean} ms"
        yield f"max {most} ms"
        yield f"jitter {jitter} ms"


# A report as a table that stays.


@contextmanager
def _live() -> Iterator[Show]:
    from rich.live import Live

    with Live(auto_refresh=False) as live:

        def show(report: Report) -> None:
            live.update(_table(report), refresh=True)

        yield show


def _table(report: Report) -> Any:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table()
    for title in ("frame", "parent", "publisher"):
        table.add_column(title, overflow="fold")
    for title in ("Hz", "delay ms", "max ms", "jitter ms"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("wrong", overflow="fold")
    wrong: dict[str, list[str]] = {}
    for finding in report.findings:
        wrong.setdefault(finding.frame, []).append(finding.kind)
    for stream in _shown(report):
        kinds = wrong.get(stream.frame, [])
        delays = (stream.delay, stream.delay_max, stream.jitter)
        table.add_row(
            # As text: a name may look like markup.
            Text(stream.frame),
            Text(stream.parent),
            Text(stream.publisher),
            "static" if stream.static else _rate(stream),
            *("" if stream.static else _ms(delay) for delay in delays),
            ", ".join(kinds),
            style="red" if kinds else None,
        )
    # Above the table: of one that is higher than the terminal the end is not seen.
    lines = [Text(text, style="red") for text in _warnings(report)]
    if report.chain is not None:
        lines.insert(0, Text(_chain_text(report.chain)))
    return Group(*lines, table)


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
    return f"{text}: net delay {_ms(mean)} ms, max {_ms(most)} ms"


def _rate(stream: Stream) -> str:
    return "?" if stream.rate is None else f"{stream.rate:.1f}"


def _ms(seconds: float | None) -> str:
    return "" if seconds is None else f"{1e3 * seconds:.1f}"


if __name__ == "__main__":
    sys.exit(main())
