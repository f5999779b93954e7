"""CPU of listening processes, lookups and waits beside messages, messages lost, loops of spin_once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import NamedTuple

from bench.processes import Failure, Process
from bench.race import OURS, Entry, Run, Sample, with_p99

SECTION = "receiving"

RECEIVED = {1: 500, 50: 200}  # transforms in a message: messages a second
# As contestants/listening.py names them.
LISTENER, EXECUTOR, FLOOR = "listener", "executor", "floor"
LOOPS = ("spin_once", "executor.spin_once")
LISTENERS = (1, 3)  # in one process

TRANSFORMS = 50
RATE = RECEIVED[TRANSFORMS]
ENDLESS = 10**9  # messages
LOOKUP = "lookup, 100 Hz"
PACE_S = 0.01
# With a pending wait, each message is inserted when it arrives, and not by the next lookup.
NO_WAIT, PENDING_WAIT = "none", "pending"

WAKE_RATE = 100
OWN_INSERT = "wait, own insert"
BLOCK, POLL = "wait, block", "wait, poll"
HOW = {BLOCK: "block", POLL: "poll"}  # as contestants/listening.py names them

LOST, SENT = "messages lost", "messages sent"
DEFAULT_QUEUE = 100


class Flood(NamedTuple):
    """Messages of which none may be lost, and what the process that receives them does meanwhile."""

    rate: int
    queue: int  # messages that fit in, on both sides
    order: str  # of contestants/listening.py; or nothing
    size: str  # seconds: a field of Sizes


FLOODS = {
    "lookups": Flood(2000, 2000, "look_often", "receive_flood_s"),
    "busy thread": Flood(2000, 2000, "keep_busy", "receive_flood_s"),
    "no reader": Flood(2000, 2000, "", "receive_unread_s"),
    "held GIL": Flood(200, DEFAULT_QUEUE, "hold_gil", "receive_held_s"),
}


def cpu(run: Run) -> None:
    """CPU of a process per message it receives under rclpy.spin, while nobody looks."""
    contenders = [(OURS, path, count) for count in LISTENERS for path in (LISTENER, FLOOR)]
    contenders += [(OURS, EXECUTOR, 1), *((who, LISTENER, 1) for who in _upstream(run))]
    _race_cpu(run, contenders, RECEIVED)


def loops(run: Run) -> None:
    """CPU of a program that calls spin_once in a loop of its own, per message."""
    contenders = [(who, path, 1) for path in LOOPS for who in (OURS, *_upstream(run))]
    _race_cpu(run, contenders, {1: RECEIVED[1]})


def _upstream(run: Run) -> list[str]:
    return [who for who in ("ros2",) if who in run.libraries]


def _race_cpu(run: Run, contenders: list[tuple[str, str, int]], loads: Mapping[int, int]) -> None:
    with run.process("publishing.py") as publisher:
        entries = [Entry(own[0], partial(_cpu, run, publisher, loads, *own)) for own in contenders]
        run.race(SECTION, entries, run.sizes.receive_rounds)


def _cpu(
    run: Run, publisher: Process, loads: Mapping[int, int], who: str, path: str, listeners: int
) -> Iterator[Sample]:
    sizes = run.sizes
    run.say(f"receiving: {run.libraries[who].title}, {path} x {listeners}")
    with run.process("listening.py", path, str(listeners), who=who) as process:
        publisher.ask("discover", listeners)
        publish(publisher, process, max(loads), max(loads.values()), sizes.receive_filling)
        # The largest messages first: every frame has a full history then, the few of the others, too.
        for transforms, rate in sorted(loads.items(), reverse=True):
            before = process.ask("cost")["cpu_ns"]
            messages = round(rate * sizes.receive_s)
            publish(publisher, process, transforms, rate, messages)
            labels = {"transforms": transforms, "Hz": rate, "listeners": listeners}
            yield Sample(who, path, labels, [(process.ask("cost")["cpu_ns"] - before) / messages])
    publisher.ask("discover", 0)


def publish(publisher: Process, listener: Process, transforms: int, rate: int, messages: int) -> None:
    first = publisher.ask("start", rate, transforms, messages)["next"]
    publisher.ask("finish")
    if not listener.ask("arrived", first + messages - 1)["arrived"]:
        raise Failure(f"the last of {messages} messages did not arrive")


def lookups(run: Run) -> None:
    """Lookups 100 times a second: they insert what has arrived, or a pending wait has had it inserted."""
    sizes = run.sizes

    def measure(process: Process, wait: str) -> Iterator[Sample]:
        run.say(f"receiving: {LOOKUP}, wait: {wait}")
        if wait == PENDING_WAIT:
            process.ask("wait_for_ever")
        times = process.ask("look_often", sizes.receive_paced * PACE_S, PACE_S)["ns"]
        if wait == PENDING_WAIT:
            process.ask("stop_waiting")
        yield from with_p99(OURS, LOOKUP, {"transforms": TRANSFORMS, "Hz": RATE, "wait": wait}, times)

    with run.process("publishing.py") as publisher, run.process("listening.py", LISTENER) as process:
        publisher.ask("discover", 1)
        publish(publisher, process, TRANSFORMS, RATE, sizes.receive_filling)
        publisher.ask("start", RATE, TRANSFORMS, ENDLESS)
        entries = [Entry(OURS, partial(measure, process, wait)) for wait in (NO_WAIT, PENDING_WAIT)]
        run.race(SECTION, entries, sizes.receive_rounds)
        publisher.ask("break_off")


def waits(run: Run) -> None:
    """How soon a waiting lookup returns: from an insert in its process, from sending in another."""
    with run.process("publishing.py") as publisher:
        entries = [Entry(who, partial(_waits, run, publisher, who)) for who in (OURS, *_upstream(run))]
        run.race(SECTION, entries, run.sizes.receive_rounds)


def _waits(run: Run, publisher: Process, who: str) -> Iterator[Sample]:
    wakes = run.sizes.receive_wakes
    run.say(f"receiving: {run.libraries[who].title}, waits")
    labels = {"Hz": WAKE_RATE}
    with run.process("listening.py", LISTENER, who=who) as process:
        publisher.ask("discover", 1)
        publish(publisher, process, 1, RECEIVED[1], run.sizes.receive_filling)
        for way in (BLOCK, POLL) if who == OURS else (BLOCK,):
            first = publisher.ask("start", WAKE_RATE, 1, wakes)["next"]
            answers = process.ask("look", first, wakes, HOW[way])["ns"]
            publisher.ask("finish")
            yield Sample(who, way, labels, answers)
        yield Sample(who, OWN_INSERT, labels, process.ask("wake", wakes, 1 / WAKE_RATE)["ns"])
    publisher.ask("discover", 0)


def losses(run: Run) -> None:
    """Messages that a buffer never got, of many or of those that arrive while Python cannot run."""
    entries = [Entry(OURS, partial(_lose, run, beside)) for beside in FLOODS]
    run.race(SECTION, entries, run.sizes.receive_flood_rounds)


def _lose(run: Run, beside: str) -> Iterator[Sample]:
    rate, queue, order, size = FLOODS[beside]
    depth = [] if queue == DEFAULT_QUEUE else [str(queue)]
    seconds = getattr(run.sizes, size)
    messages = round(rate * seconds)
    run.say(f"receiving: {messages} messages at {rate} Hz beside: {beside}")
    labels = {"Hz": rate, "queue": queue, "beside": beside}
    with (
        run.process("publishing.py", *depth) as publisher,
        run.process("listening.py", LISTENER, "1", *depth) as process,
    ):
        publisher.ask("discover", 1)
        publisher.ask("start", rate, TRANSFORMS, messages)
        if order:
            process.ask(order, seconds)
        sent_s = publisher.ask("finish")["seconds"]
        lost = messages - process.ask("received")["received"] / TRANSFORMS
    yield Sample(OURS, LOST, labels, [lost], "messages")
    # A busy machine may not send as many a second as are wanted.
    yield Sample(OURS, SENT, labels, [messages / sent_s], "/s")


PARTS = (cpu, lookups, waits, losses, loops)
