"""Owns measuring lookups while another process publishes transforms over DDS."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from bench.arena import OURS, Arena, Entry
from bench.lookups import HOPS
from bench.processes import CONTESTANTS, Failure, Library, Process, clean_environment
from bench.rows import row_of
from bench.trees import Tree, bushy

SECTION = "online"
AGES_S = {"past": 0.5, "latest": 0.0}
PAIRS = 100


def domain() -> int:
    """A ROS domain that hardly anyone else on this machine uses."""
    return 60 + os.getpid() % 40


def run(arena: Arena) -> None:
    frames = arena.sizes.dynamic_frames[0]
    tree = bushy(f"online {frames}", frames, 0.5, 2)
    tree.write(arena.folder)
    for who in (OURS, "ros2"):
        if who in arena.libraries:
            arena.say(f"online: {arena.libraries[who].label} listens to a publishing process")
            try:
                _run_library(arena, who, tree)
            except Failure as failure:
                arena.absent.append({"who": who, "what": SECTION, "reason": str(failure)})


def _run_library(arena: Arena, who: str, tree: Tree) -> None:
    # Of this machine only, and of no other ROS 2 on it.
    network = {"ROS_DOMAIN_ID": str(domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    library = arena.libraries[who]
    library = replace(library, environment={**library.environment, **network})
    process = Process(library)
    try:
        with _publisher(library, arena, tree):
            process.ask("listen", tree.cache_s, len(tree.names), seconds=60)
            _measure(arena, process, who, tree)
            process.ask("deafen", seconds=60)
    finally:
        process.end()


def _measure(arena: Arena, process: Process, who: str, tree: Tree) -> None:
    sizes = arena.sizes
    entries = []
    for place, age_s in AGES_S.items():
        for hops in HOPS:
            pairs = tree.pairs(hops, PAIRS, seed=hops, must_move=True)
            asked = ",".join(f"{tree.names[target]} {tree.names[source]}" for target, source in pairs)
            for way in arena.libraries[who].ways:
                labels = {"tree": tree.name, "place": place, "hops": hops}
                process.ask("online", way, asked, age_s, sizes.warm_up, sizes.budget_s)
                entries.append(Entry(who, way, labels, ("online", way, asked, age_s, sizes.calls)))
    values: list[list[list[float]]] = [[] for _ in entries]
    failed, empty = [0] * len(entries), [0.0] * len(entries)
    for _ in range(sizes.rounds):
        for i, entry in enumerate(entries):
            answer = process.ask(*entry.order, sizes.budget_s)
            values[i].append([ns - answer["empty_ns"] for ns in answer["ns"]])
            failed[i] += answer["failed"]
            empty[i] = answer["empty_ns"]
    for i, entry in enumerate(entries):
        if any(values[i]):
            arena.rows.append(
                row_of(SECTION, who, entry.way, entry.labels, values[i], failed=failed[i], empty_ns=empty[i])
            )


@contextmanager
def _publisher(library: Library, arena: Arena, tree: Tree) -> Iterator[None]:
    process = subprocess.Popen(
        [library.command[0], str(CONTESTANTS / "publisher.py"), str(arena.folder / f"{tree.name}.tree")],
        stdin=subprocess.PIPE,
        stdout=sys.stderr,
        env=clean_environment(library.environment),
    )
    assert process.stdin is not None
    try:
        yield
    finally:
        process.stdin.close()
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
