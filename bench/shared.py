"""Measure shared buffers: lookups, waits, memory, attaching and nodes, beside private buffers."""

from __future__ import annotations

import math
import os
import statistics
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import NamedTuple

import numpy as np

from bench.lookups import DEEP_HOPS
from bench.processes import SHARED_BUFFER, Process
from bench.race import CHECKED, OURS, Entry, Rows, Run, Sample, largest_deviation, with_p99
from bench.trees import LATEST, Tree, bushy, queries_of, vector_queries_of

SECTION = "shared"
PRIVATE, ATTACHED = "private", "attached"  # buffers, as contestants/sharing.py names them

TRANSFORMS, RATE = 50, 200  # in a message; messages a second
ENDLESS = 10**9  # messages
RESTS, INSERTS = "rests", "inserts"  # what the owner does meanwhile
PAST, NOW, VECTOR, PACED = "past", "latest", "1000 times", "past, 100 Hz"
TIMES = 1000  # in one vector lookup
SHARE = {PAST: 1.0, NOW: 1.0, VECTOR: 0.1}  # of sizes.calls
CACHE_S = 600  # nothing that is looked up is dropped meanwhile

BLOCK, POLL = "wait, block", "wait, poll"
HOW = {BLOCK: "block", POLL: "poll"}  # as contestants/listening.py names them
WAIT_RATE = 100

ATTACH, FIRST_ATTACH = "attach", "attach, first in its process"
ATTACHED_SAMPLES = 100  # of each frame that moves
MEGABYTE = 1e6

# What nodes are, as contestants/spinning.py names them; beside those that are attached.
LISTENING, LOOKING, IDLE, OWNER = "listening", "looking", "idle", "owner"
BY_OWNER = (ATTACHED, LOOKING)


@contextmanager
def _sharing(run: Run, what: str) -> Iterator[tuple[Process, str]]:
    """The owner of a new shared buffer, and its name."""
    name = f"bench-{what}-{os.getpid()}"
    with run.process("sharing.py", "owner", name) as owner:
        yield owner, name


class Call(NamedTuple):
    """A set of queries that the reader has prepared for one of its buffers."""

    call: str
    which: str
    way: str
    name: str
    deviation: float | None  # of its answers from the private buffer's

    def entry(self, run: Run, reader: Process, does: str) -> Entry:
        labels = {"call": self.call, "owner": does}
        per = TIMES if self.call == VECTOR else 1
        order = "time", self.way, self.name, round(run.sizes.calls * SHARE[self.call])
        return run.timed(OURS, self.which, labels, order, per, self.deviation, reader)

    def paced(self, run: Run, reader: Process) -> Iterator[Sample]:
        times = reader.ask("paced", self.way, self.name, run.sizes.shared_paced)["ns"]
        yield Sample(OURS, self.which, {"call": PACED, "owner": INSERTS}, times)


def lookups(run: Run) -> None:
    sizes = run.sizes
    frames = sizes.dynamic_frames[0]
    tree = bushy(f"{SECTION} {frames}", frames, 0.5, round(sizes.seconds * 100))
    tree.cache_s = CACHE_S
    path = tree.write(run.folder)
    with _sharing(run, "lookups") as (owner, name), run.process("sharing.py", "reader", name) as reader:
        for process in owner, reader:
            process.ask("load", path, 0)
        calls = _prepared(run, tree, reader)
        run.say("shared: lookups while the owner rests")
        run.race(SECTION, [call.entry(run, reader, RESTS) for call in calls])
        run.say("shared: lookups while the owner inserts")
        for process in owner, reader:
            process.ask("start", RATE, TRANSFORMS, ENDLESS)
        run.race(SECTION, [call.entry(run, reader, INSERTS) for call in calls])
        past = [Entry(OURS, partial(call.paced, run, reader)) for call in calls if call.call == PAST]
        run.race(SECTION, past)
        for process in owner, reader:
            process.ask("break_off")


def _prepared(run: Run, tree: Tree, reader: Process) -> list[Call]:
    """Each call on the private buffer and on the attached one, next to each other, warmed up."""
    sizes = run.sizes
    pairs = tree.pairs(DEEP_HOPS, sizes.queries, seed=DEEP_HOPS, must_move=True)
    few = pairs[: sizes.vector_pairs]
    runs_of_times = [np.sort(tree.random_times(TIMES, seed)) for seed in range(len(few))]
    prepared = []
    for call, way, queries in (
        (PAST, "buffer", queries_of(pairs, tree.random_times(sizes.queries, seed=1))),
        (NOW, "buffer", queries_of(pairs, np.full(sizes.queries, LATEST))),
        (VECTOR, "vector", vector_queries_of(few, runs_of_times)),
    ):
        truth: list[list[float] | None] = []
        for which in PRIVATE, ATTACHED:
            reader.ask("use", which)
            name = f"{call}/{which}"
            answers = reader.ask("prepare", way, name, run.write(queries), CHECKED)["answers"]
            truth = truth or answers
            prepared.append(Call(call, which, way, name, largest_deviation(truth, answers)))
            reader.ask("time", way, name, sizes.warm_up, sizes.budget_s)
    return prepared


def waits(run: Run) -> None:
    """From just before a message is made and inserted, until a lookup in another process returns."""
    sizes = run.sizes
    labels = {"transforms": TRANSFORMS, "Hz": WAIT_RATE}
    with _sharing(run, "waits") as (owner, name), run.process("sharing.py", "reader", name) as reader:
        owner.ask("new", CACHE_S)
        reader.ask("use", ATTACHED)

        def look(way: str) -> Iterator[Sample]:
            run.say(f"shared: {way}")
            first = owner.ask("start", WAIT_RATE, TRANSFORMS, sizes.shared_waits)["next"]
            answers = reader.ask("look", first, sizes.shared_waits, HOW[way])["ns"]
            owner.ask("finish")
            yield from with_p99(OURS, way, labels, answers)

        run.race(SECTION, [Entry(OURS, partial(look, way)) for way in HOW], sizes.shared_rounds)


def memory(run: Run) -> None:
    """What a process grows by, with a private buffer and with an attached one whose samples are all read."""
    sizes = run.sizes
    tree = bushy(f"{SECTION} memory", sizes.shared_frames + 1, 1.0, round(sizes.seconds * 100))
    path = tree.write(run.folder)

    def measure(name: str, which: str) -> Iterator[Sample]:
        with run.process("sharing.py", "reader", name) as reader:
            answer = reader.ask("memory", which, path, tree.first_ns, tree.newest_ns)
        for kind, bytes_ in answer.items():
            labels = {"memory": kind, "samples": sizes.shared_frames * tree.samples}
            yield Sample(OURS, which, labels, [bytes_ / MEGABYTE], "MB")

    run.say("shared: memory")
    with _sharing(run, "memory") as (owner, name):
        owner.ask("load", path, 0)
        entries = [Entry(OURS, partial(measure, name, which)) for which in (PRIVATE, ATTACHED)]
        run.race(SECTION, entries, sizes.shared_rounds)


def attaching(run: Run) -> None:
    sizes = run.sizes
    tree = bushy(f"{SECTION} attach", sizes.static_frames, 0.5, ATTACHED_SAMPLES)
    labels = {"frames": sizes.static_frames}

    def measure(name: str) -> Iterator[Sample]:
        with run.process("sharing.py", "reader", name) as reader:
            first, *others = reader.ask("attach", sizes.shared_attaches)["ns"]
        yield Sample(OURS, FIRST_ATTACH, labels, [first])
        yield Sample(OURS, ATTACH, labels, others)

    run.say("shared: attaching")
    with _sharing(run, "attach") as (owner, name):
        owner.ask("load", tree.write(run.folder), 0)
        run.race(SECTION, [Entry(OURS, partial(measure, name))], sizes.shared_rounds)


def nodes(run: Run) -> None:
    """CPU of many nodes while another process publishes."""
    count = run.sizes.shared_nodes
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
        run.race(SECTION, entries, run.sizes.shared_rounds)


def _spin(run: Run, publisher: Process, what: str, count: int) -> Iterator[Sample]:
    """CPU seconds per second of nodes of one kind together; of attached ones and their owner."""
    sizes = run.sizes
    run.say(f"shared: {count} nodes, {what}")
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


def nodes_ratio(rows: Rows) -> float:
    """The attached nodes and their owner over one node that listens and as many idle ones."""
    one = rows.find(SECTION, OURS, LISTENING, nodes=1)
    idle = rows.find(SECTION, OURS, IDLE)
    together = idle and rows.find(SECTION, OURS, ATTACHED, **idle.labels)
    if one is None or idle is None or together is None:
        return math.nan
    rounds = zip(together.rounds, one.rounds, idle.rounds, strict=True)
    return statistics.median(attached / (listening + resting) for attached, listening, resting in rounds)


def looking_us(rows: Rows) -> float:
    """What an attached node that looks ten times a second costs more, in µs for each transform sent."""
    looking = rows.find(SECTION, OURS, LOOKING)
    resting = looking and rows.find(SECTION, OURS, ATTACHED, **looking.labels)
    if looking is None or resting is None:
        return math.nan
    more = statistics.median(a - b for a, b in zip(looking.rounds, resting.rounds, strict=True))
    return more / (looking.labels["nodes"] * TRANSFORMS * RATE) * 1e6


# Each measures by itself, too.
PARTS = (lookups, waits, memory, attaching, nodes)
