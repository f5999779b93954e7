"""Owns the section that measures the programs which watch transforms."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from bench.nodes import publish
from bench.processes import Process
from bench.race import OURS, Entry, Run, Sample

TRANSFORMS, RATE = 50, 200  # in a message; messages a second
LISTENER = "listener"
# What takes part: a contestant and its arguments.
WATCHING: dict[str, tuple[str, ...]] = {
    LISTENER: ("listening.py", "listener"),
    "tf2_monitor": ("watching.py", "tf2_monitor", "--interval", "1"),
    "tf2_monitor, live": ("watching.py", "live", "tf2_monitor"),
    "tf2_check": ("watching.py", "tf2_check", "-t", "3600"),
}


def watch(run: Run) -> None:
    """CPU of the programs that watch transforms, beside a listener's."""
    with run.process("publishing.py") as publisher:
        entries = [Entry(OURS, partial(_watch, run, publisher, way)) for way in WATCHING]
        run.race("watch", entries, run.sizes.receive_rounds)


def _watch(run: Run, publisher: Process, way: str) -> Iterator[Sample]:
    run.say(f"watch: {way}")
    labels = {"transforms": TRANSFORMS, "Hz": RATE}
    messages = round(RATE * run.sizes.receive_s)
    with run.process(*WATCHING[way]) as process:
        publisher.ask("discover", 1)
        publish(publisher, process, TRANSFORMS, RATE, run.sizes.receive_filling)
        before = process.ask("cost")["cpu_ns"]
        publish(publisher, process, TRANSFORMS, RATE, messages)
        yield Sample(OURS, way, labels, [(process.ask("cost")["cpu_ns"] - before) / messages])
    publisher.ask("discover", 0)
