"""Owns measuring what it costs to listen, and how soon a lookup wakes (`python -m bench.receive`)."""

from __future__ import annotations

import argparse
import statistics
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Any

from bench import machine, online, peers
from bench.processes import CONTESTANTS, Failure, Library, Process
from bench.rows import row_of

SECTION = "receive"
LOADS = {1: 500, 50: 200}  # transforms in a message: messages per second
FILLING = 700  # messages; from then on each drops an old sample, as in a program that runs for long
WAKE_RATE = 100
ROADS = {
    "listener": "TransformListener",
    "executor": "every transform through Python",
    "spin_once": "a loop of spin_once",
    "floor": "takes the bytes and drops them",
}
# What ROS 2 Jazzy's Python needed on the machine of the published figures, in us of CPU per message; how
# often ours is to fit into that; and how much above the floor it may be.
JAZZY_US = {1: 214.0, 50: 1139.0}
LESS_THAN_JAZZY = {1: 8.0, 50: 20.0}
ABOVE_FLOOR = 1.3
SPIN_ONCE_OF_UPSTREAM = 0.75
LOOKING = ("listener", "executor")  # the roads on which lookups are timed
WAKE_MEDIAN_MS, WAKE_MOST_MS = 0.2, 1.0


@dataclass
class Plan:
    """How much is measured."""

    rounds: int
    filling: int  # messages before each load
    seconds: float  # of publishing, for each load in each round
    wakes: int  # lookups of each kind in each round


FULL = Plan(rounds=7, filling=FILLING, seconds=5.0, wakes=200)
QUICK = Plan(rounds=3, filling=FILLING, seconds=2.0, wakes=100)


def run(quick: bool) -> list[dict[str, Any]]:
    """
    Rows of :mod:`bench.rows`, in ns.

    CPU per message of the listening process, and of the receiver's thread alone; and the time from the
    sending of a message to the answer of a lookup that waited for it, or that was asked again and again.
    """
    return measure(QUICK if quick else FULL)


def measure(plan: Plan) -> list[dict[str, Any]]:
    """As :func:`run`, by a plan."""
    rounds: dict[tuple[str, str, tuple[tuple[str, int], ...]], list[list[float]]] = {}
    contenders = _contenders()
    publisher = Process(_library(peers.ours(), "flooding.py"))
    try:
        for _ in range(plan.rounds):
            for who, road, library in contenders:
                with _listening(library, publisher) as listener:
                    for way, labels, ns in _measured(publisher, listener, who, road, plan):
                        rounds.setdefault((who, way, tuple(labels.items())), []).append(ns)
    finally:
        publisher.end()
    return [asdict(row_of(SECTION, who, way, dict(labels), ns)) for (who, way, labels), ns in rounds.items()]


def _contenders() -> list[tuple[str, str, Library]]:
    found = [("ours", road, _library(peers.ours(), "listening.py", road)) for road in ROADS]
    try:
        for road in ("listener", "spin_once"):
            found.append(("ros2", road, _library(peers.sourced_ros2(), "listening.py", road)))
    except Failure as failure:
        print(f"without upstream's listener: {failure}", file=sys.stderr)
    return found


def _library(library: Library, program: str, *arguments: str) -> Library:
    # Of this machine only, and of no other ROS 2 on it.
    network = {"ROS_DOMAIN_ID": str(online.domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    command = [library.command[0], str(CONTESTANTS / program), *arguments]
    return replace(library, command=command, environment={**library.environment, **network})


@contextmanager
def _listening(library: Library, publisher: Process) -> Iterator[Process]:
    """A process that the publisher has found, and that alone."""
    process = Process(library)
    try:
        publisher.ask("discover", 1, seconds=60)
        yield process
    finally:
        process.end()
    publisher.ask("discover", 0, seconds=60)


def _measured(
    publisher: Process, listener: Process, who: str, road: str, plan: Plan
) -> Iterator[tuple[str, dict[str, int], list[float]]]:
    for transforms, rate in LOADS.items():
        labels = {"transforms": transforms, "rate": rate}
        _publish(publisher, listener, road, transforms, max(LOADS.values()), plan.filling)
        before = listener.ask("cost")
        messages = round(rate * plan.seconds)
        _publish(publisher, listener, road, transforms, rate, messages)
        after = listener.ask("cost")
        yield road, labels, [(after["cpu_ns"] - before["cpu_ns"]) / messages]
        thread = "tf2_ros receiver"
        if thread in after["threads"]:
            own = after["threads"][thread] - before["threads"][thread]
            if own > 0:  # it may be there for static transforms alone
                yield f"{road}, its thread", labels, [own / messages]
    if road in LOOKING:
        for how in ("block", "poll") if who == "ours" else ("block",):
            first = publisher.ask("start", WAKE_RATE, 1, plan.wakes)["next"]
            answer = listener.ask("look", first, plan.wakes, how)
            publisher.ask("finish")
            if answer["s"]:
                yield f"{road}, {how}", {"rate": WAKE_RATE}, [1e9 * s for s in answer["s"]]


def _publish(
    publisher: Process, listener: Process, road: str, transforms: int, rate: int, messages: int
) -> None:
    first = publisher.ask("start", rate, transforms, messages)["next"]
    publisher.ask("finish")
    if road == "floor":
        listener.ask("settle")
    elif not listener.ask("knows", first + messages - 1)["knows"]:
        raise Failure(f"of {messages} messages the last did not come")


def table(rows: list[dict[str, Any]]) -> str:
    """What was measured, and the two targets beside it."""
    at = {(row["who"], row["way"], row["labels"].get("transforms")): row for row in rows}
    lines = ["CPU of the listening process, us per message (5th and 95th percentile of the rounds)"]
    for (who, way, transforms), row in at.items():
        if transforms is not None:
            title = f"upstream: {_title(way)}" if who == "ros2" else _title(way)
            load = f"{transforms} transforms at {LOADS[transforms]} Hz"
            lines.append(f"  {load:24}{title:44}{_us(row)}")
    lines.append("From the sending of a message to the answer, us (5th and 95th percentile)")
    for (who, way, transforms), row in at.items():
        if transforms is None:
            title = "upstream's TransformListener, block" if who == "ros2" else _title(way)
            lines.append(f"  {title:68}{_us(row)}")
    return "\n".join([*lines, *_verdicts(at)])


def _title(way: str) -> str:
    road, *rest = way.split(", ")
    return ", ".join([ROADS[road], *rest])


def _us(row: dict[str, Any]) -> str:
    return f"{row['median'] / 1e3:9.1f}  ({row['p05'] / 1e3:.1f}-{row['p95'] / 1e3:.1f})"


def _verdicts(at: dict[tuple[str, str, int | None], dict[str, Any]]) -> Iterator[str]:
    yield "Targets (ratios are medians of the rounds' ratios)"
    for transforms in LOADS:
        own, floor = at["ours", "listener", transforms], at["ours", "floor", transforms]
        peer, title = at.get(("ros2", "listener", transforms)), "upstream's"
        if peer is None:
            peer, title = at["ours", "executor", transforms], "every transform through Python"
        published = JAZZY_US[transforms] * 1e3 / own["median"]
        wanted = LESS_THAN_JAZZY[transforms]
        yield (
            f"  5  {transforms} transforms: {_ratio(peer, own):.1f}x less CPU than {title}, {published:.1f}x "
            f"less than published of Jazzy; wanted at least {wanted:.0f}x less than Jazzy"
        )
        above = _ratio(own, floor)
        yield f"  5  {transforms} transforms: {above:.2f}x the floor; wanted at most {ABOVE_FLOOR}x"
    own, floor = at["ours", "spin_once", 1], at["ours", "floor", 1]
    peer = at.get(("ros2", "spin_once", 1))
    if peer is None:
        yield f" 11  a loop of spin_once: {_ratio(own, floor):.2f}x the floor; no upstream to compare with"
    else:
        yield (
            f" 11  a loop of spin_once: {_ratio(own, peer):.2f}x of upstream's CPU; wanted at most "
            f"{SPIN_ONCE_OF_UPSTREAM}x"
        )
    blocked, polled = at["ours", "listener, block", None], at["ours", "listener, poll", None]
    # Who polls sees what is in the buffer at once.
    wake_ms = (blocked["median"] - polled["median"]) / 1e6
    yield f"  7  wake-up: {wake_ms:.3f} ms later than who polls (medians); wanted under {WAKE_MEDIAN_MS} ms"
    yield (
        f"  7  wake-up: 19 of 20 within {blocked['p95'] / 1e6:.3f} ms of the sending of the message; wanted "
        f"within {WAKE_MOST_MS} ms of the insert"
    )


def _ratio(above: dict[str, Any], below: dict[str, Any]) -> float:
    # Of what was measured within seconds of each other: whatever else the machine does, weighs on both.
    return statistics.median(a / b for a, b in zip(above["rounds"], below["rounds"], strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.receive", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer and shorter rounds")
    quick = parser.parse_args().quick
    before = machine.load_average()[0]
    print(table(run(quick)))
    print(f"load average before {before}, after {machine.load_average()[0]}")


if __name__ == "__main__":
    main()
