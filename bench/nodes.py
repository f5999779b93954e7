"""Measure nodes beside a process that publishes: lookups of one, and the CPU of twenty, shared or not."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from bench.lookups import HOPS
from bench.processes import SHARED_BUFFER, Process
from bench.race import OURS, Entry, Run, Sample, with_p99
from bench.trees import Tree, bushy

ONLINE_AGE_S = 0.5  # of the times that are looked up
ONLINE_BATCH, ONLINE_PAUSE_S = 25, 0.025  # 1,000 lookups a second
ONLINE_CPU = "CPU"
PAIRS = 100

TRANSFORMS, RATE = 50, 200  # in a message; messages a second
# What nodes are, as contestants/spinning.py names them; beside those that are attached.
LISTENING, ATTACHED, LOOKING, IDLE, OWNER = "listening", "attached", "looking", "idle", "owner"
BY_OWNER = (ATTACHED, LOOKING)


def online(run: Run) -> None:
    """The online scenario of the published evaluation: lookups while another process publishes a tree."""
    frames = run.sizes.online_frames
    tree = bushy(f"online {frames}", frames, 0.5, 2)
    path = tree.write(run.folder)
    with run.process("publishing.py") as publisher:
        publisher.ask("tree", path)
        listeners = filter(run.libraries.__contains__, (OURS, "ros2"))
        entries = [Entry(who, partial(_online, run, tree, who)) for who in listeners]
        run.race("online", entries, run.sizes.online_rounds)


def _online(run: Run, tree: Tree, who: str) -> Iterator[Sample]:
    library, seconds = run.libraries[who], run.sizes.online_s
    run.say(f"online: {library.label}")
    with run.process(Path(library.command[1]).name, who=who) as process:
        process.ask("listen", tree.cache_s, len(tree.names))
        for hops in HOPS:
            pairs = tree.pairs(hops, PAIRS, seed=hops, must_move=True)
            names = [(tree.names[target], tree.names[source]) for target, source in pairs]
            labels = {"tree": tree.name, "place": "past", "hops": hops}
            before_ns = process.cpu_ns()
            times = process.ask("online", names, ONLINE_AGE_S, ONLINE_BATCH, ONLINE_PAUSE_S, seconds)["ns"]
            yield Sample(who, ONLINE_CPU, labels, [(process.cpu_ns() - before_ns) / 1e9 / seconds], "CPU")
            yield from with_p99(who, "buffer", labels, times)


def many(run: Run) -> None:
    """CPU of many nodes while another process publishes."""
    count = run.sizes.nodes
    with run.process("publishing.py") as publisher:
        entries = [
            Entry(OURS, partial(_spin, run, publisher, what, nodes))
            for what, nodes in (
                (LISTENING, 1),
                (LISTENING, count),
                (ATTACHED, count),
                (LOOKING, count),
                (IDLE, count),
            )
        ]
        run.race("nodes", entries, run.sizes.nodes_rounds)


def _spin(run: Run, publisher: Process, what: str, count: int) -> Iterator[Sample]:
    """CPU seconds per second of nodes of one kind together; of attached ones and their owner."""
    sizes = run.sizes
    run.say(f"nodes: {count}, {what}")
    name = f"bench-nodes-{os.getpid()}"
    messages = round(RATE * sizes.receive_s)
    with ExitStack() as stack:
        owners = [_node(run, stack, OWNER, name)] if what in BY_OWNER else []
        for node in owners:
            node.ask("ready", 0)
        nodes = [*owners, *(_node(run, stack, what, name) for _ in range(count))]
        for node in nodes:
            node.ask("ready", 0)
        publisher.ask("discover", {LISTENING: count, IDLE: 0}.get(what, len(owners)))
        publisher.ask("start", RATE, TRANSFORMS, sizes.receive_filling)
        publisher.ask("finish")
        for node in nodes:
            node.ask("ready", TRANSFORMS)
        before_ns = sum(node.cpu_ns() for node in nodes), publisher.cpu_ns()
        began_ns = time.monotonic_ns()
        publisher.ask("start", RATE, TRANSFORMS, messages)
        publisher.ask("finish")
        seconds = (time.monotonic_ns() - began_ns) / 1e9
        after_ns = sum(node.cpu_ns() for node in nodes), publisher.cpu_ns()
        labels = {"nodes": count}
        for way, before, after in zip((what, f"publisher, {what}"), before_ns, after_ns, strict=True):
            yield Sample(OURS, way, labels, [(after - before) / 1e9 / seconds], "CPU")
        # One by one their ends would take as long as the rest.
        with ThreadPoolExecutor(len(nodes)) as pool:
            list(pool.map(Process.end, nodes))
    publisher.ask("discover", 0)


def _node(run: Run, stack: ExitStack, what: str, name: str) -> Process:
    environment = {SHARED_BUFFER: name} if what in BY_OWNER else {}
    return stack.enter_context(run.process("spinning.py", what, name, environment=environment))
