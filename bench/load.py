"""Owns measuring how long readers and writers of one buffer hold each other up."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from bench import online
from bench.arena import OURS, Arena
from bench.processes import CONTESTANTS, Failure, Library, Process
from bench.rows import percentile, row_of

SECTION = "load"
READERS = 4
RATE = 100  # messages a second beside the readers
DEPTH = 100  # of a listener's queue, where nobody says another
HEAVY = {10_000: 20, 50: 2000}  # transforms in a message: messages a second beside lookups
CALLS = {"lookup_transform": 1.0, "set_transform": 1.0, "lookup_transforms": 0.01}  # of sizes.load_calls
TIMES = {"lookup_transforms": 10_000}  # in one call
BUFFERS = ("this", "other")
INSERT, LATE, LOST = "insert, p99", "sleep of 1 ms is late, p99", "messages lost"
LOOKUP = "lookup, p99.9"


def run(arena: Arena) -> None:
    publisher = Process(_library(arena.libraries[OURS], "flooding.py"))
    loaded = Process(_library(arena.libraries[OURS], "loaded.py"))
    try:
        _run_threads(arena, loaded)
        _run_beside_readers(arena, loaded)
        _run_messages_beside_readers(arena, loaded, publisher)
        _run_beside_messages(arena, loaded, publisher)
    except Failure as failure:
        arena.absent.append({"who": OURS, "what": SECTION, "reason": str(failure)})
    finally:
        loaded.end()
        publisher.end()


def _library(library: Library, program: str) -> Library:
    # Of this machine only, and of no other ROS 2 on it.
    network = {"ROS_DOMAIN_ID": str(online.domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    command = [library.command[0], str(CONTESTANTS / program)]
    return replace(library, command=command, environment={**library.environment, **network})


def _add(arena: Arena, way: str, labels: dict[str, Any], rounds: list[float], unit: str = "ns") -> None:
    arena.rows.append(row_of(SECTION, OURS, way, labels, [[value] for value in rounds], unit=unit))


def _run_threads(arena: Arena, loaded: Process) -> None:
    """The same calls alone and in several threads at once."""
    for what, share in CALLS.items():
        arena.say(f"load: {what} in 1 thread and in {READERS}")
        calls = round(arena.sizes.load_calls * share)
        values: dict[int, list[float]] = {1: [], READERS: []}
        for _ in range(arena.sizes.load_rounds):
            for threads, ns in values.items():
                ns.append(loaded.ask("together", what, threads, calls)["ns"] / TIMES.get(what, 1))
        for threads, ns in values.items():
            _add(arena, what, {"threads": threads}, ns)


def _run_beside_readers(arena: Arena, loaded: Process) -> None:
    inserts: dict[str, list[float]] = {which: [] for which in BUFFERS}
    late: dict[str, list[float]] = {which: [] for which in BUFFERS}
    for turn in range(arena.sizes.load_rounds):
        arena.say(f"load: inserts beside {READERS} readers, round {turn + 1}")
        for which in BUFFERS:
            loaded.ask("read", which, READERS)
            answer = loaded.ask("insert", arena.sizes.load_s, seconds=60)
            _stop(loaded)
            inserts[which].append(percentile(sorted(answer["inserts"]), 0.99))
            late[which].append(percentile(sorted(answer["late"]), 0.99))
    for which in BUFFERS:
        _add(arena, INSERT, {"readers": READERS, "of": which}, inserts[which])
        _add(arena, LATE, {"readers": READERS, "of": which}, late[which])


def _run_messages_beside_readers(arena: Arena, loaded: Process, publisher: Process) -> None:
    messages = arena.sizes.load_messages
    arena.say(f"load: {messages} messages at {RATE} Hz beside {READERS} readers")
    before = _listen(loaded, publisher, "this", DEPTH)
    loaded.ask("read", "this", READERS)
    publisher.ask("start", RATE, 1, messages)
    publisher.ask("finish")
    _stop(loaded)
    lost = messages - (loaded.ask("settle", "this")["taken"] - before)
    _deafen(loaded, publisher)
    _add(arena, LOST, {"readers": READERS, "of": "this", "messages": messages}, [lost], unit="messages")


def _run_beside_messages(arena: Arena, loaded: Process, publisher: Process) -> None:
    for transforms, rate in HEAVY.items():
        slowest: dict[str, list[float]] = {which: [] for which in BUFFERS}
        for turn in range(arena.sizes.load_rounds):
            arena.say(f"load: lookups beside {rate} messages/s of {transforms}, round {turn + 1}")
            for which in BUFFERS:
                _listen(loaded, publisher, which, rate)
                publisher.ask("start", rate, transforms, round(rate * arena.sizes.load_s))
                answer = loaded.ask("look", arena.sizes.load_s, seconds=60)
                publisher.ask("finish")
                _deafen(loaded, publisher)
                slowest[which].append(percentile(sorted(answer["lookups"]), 0.999))
        for which in BUFFERS:
            _add(arena, LOOKUP, {"transforms": transforms, "Hz": rate, "into": which}, slowest[which])


def _stop(loaded: Process) -> None:
    if loaded.ask("stop", seconds=60)["read"] == 0:
        raise Failure("the readers have read nothing")


def _listen(loaded: Process, publisher: Process, which: str, depth: int) -> int:
    taken: int = loaded.ask("listen", which, depth)["taken"]
    publisher.ask("discover", 1, seconds=60)
    return taken


def _deafen(loaded: Process, publisher: Process) -> None:
    loaded.ask("deafen")
    publisher.ask("discover", 0, seconds=60)
