"""Owns the sections that measure nodes: lookups online, readers and writers at once, receiving."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np

from bench.lookups import DEEP_HOPS, HOPS
from bench.processes import Failure, Process
from bench.race import OURS, Entry, Run, Sample
from bench.trees import bushy, chain, vector_queries_of

AGES_S = {"past": 0.5, "latest": 0.0}
PAIRS = 100

READERS = 4
RATE = 100  # messages a second beside the readers
DEPTH = 100  # of a listener's queue
HEAVY = {10_000: 20, 50: 2000}  # transforms in a message: messages a second beside lookups
# Way, as it is prepared: share of sizes.load_calls, times in one call.
IN_THREADS = {
    "lookup_transform": ("buffer", 1.0, 1),
    "set_transform": ("set_transform", 1.0, 1),
    "lookup_transforms": ("vector", 0.01, 10_000),
}
BUFFERS = ("this", "other")
INSERT, LATE, LOST = "insert, p99", "sleep of 1 ms is late, p99", "messages lost"
LOOKUP = "lookup, p99.9"

RECEIVED = {1: 500, 50: 200}  # transforms in a message: messages a second
WAKE_RATE = 100
OUR_PATHS = ("listener", "executor", "spin_once", "floor")  # as contestants/listening.py names them
UPSTREAM_PATHS = ("listener", "spin_once")
WAKING = ("listener", "executor")  # paths on which lookups wait
RECEIVER_THREAD = "tf2_ros receiver"


def online(run: Run) -> None:
    """Lookups while another process publishes transforms over DDS."""
    sizes = run.sizes
    frames = sizes.dynamic_frames[0]
    tree = bushy(f"online {frames}", frames, 0.5, 2)
    path = tree.write(run.folder)
    for who in filter(run.libraries.__contains__, (OURS, "ros2")):
        run.say(f"online: {run.libraries[who].label} listens to a publishing process")
        program = run.libraries[who].command[1]
        with (
            run.recording_failure(who, "online"),
            run.process("publishing.py", who=who) as publisher,
            run.process(program, who=who) as process,
        ):
            publisher.ask("tree", path)
            process.ask("listen", tree.cache_s, len(tree.names))
            entries = []
            for place, age_s in AGES_S.items():
                for hops in HOPS:
                    pairs = tree.pairs(hops, PAIRS, seed=hops, must_move=True)
                    names = [(tree.names[target], tree.names[source]) for target, source in pairs]
                    for way in run.libraries[who].ways:
                        labels = {"tree": tree.name, "place": place, "hops": hops}
                        process.ask("online", way, names, age_s, sizes.warm_up, sizes.budget_s)
                        order = "online", way, names, age_s, sizes.calls
                        entries.append(run.timed(who, way, labels, order, process=process))
            run.race("online", entries)
            process.ask("stop_listening")


def load(run: Run) -> None:
    """How long readers and writers of one buffer delay each other."""
    tree = chain("load", HOPS[-1], 100)
    tree.cache_s = 10.0
    with run.process("publishing.py") as publisher, run.process("ours.py") as loaded:
        loaded.ask("load", tree.write(run.folder), 0)
        loaded.ask("load_other")
        for way, times in ("buffer", 1), ("vector", IN_THREADS["lookup_transforms"][2]):
            stamps = np.sort(tree.random_times(times, 1))
            queries = vector_queries_of([(0, DEEP_HOPS)], [stamps])
            loaded.ask("prepare", way, "load", run.write(queries), 0)
        _race_threads(run, loaded)
        _race_beside_readers(run, loaded)
        _messages_beside_readers(run, loaded, publisher)
        _race_beside_messages(run, loaded, publisher)


def _race_threads(run: Run, loaded: Process) -> None:
    """The same calls alone and in several threads at once."""

    def measure(what: str, threads: int) -> Iterator[Sample]:
        way, share, times = IN_THREADS[what]
        calls = round(run.sizes.load_calls * share)
        ns = loaded.ask("threads", way, "load", threads, calls)["ns"]
        yield Sample(OURS, what, {"threads": threads}, [ns / (threads * calls * times)])

    run.say(f"load: calls in 1 thread and in {READERS}")
    for what in IN_THREADS:
        entries = [Entry(OURS, partial(measure, what, n)) for n in (1, READERS)]
        run.race("load", entries, run.sizes.load_rounds)


def _race_beside_readers(run: Run, loaded: Process) -> None:
    def measure(which: str) -> Iterator[Sample]:
        run.say(f"load: inserts beside {READERS} readers of {which} buffer")
        with _readers(loaded, which) as late:
            loaded.ask("sleep")
            inserts = loaded.ask("probe", "set_transform", run.sizes.load_s)["ns"]
        for way, values in (INSERT, inserts), (LATE, late):
            yield Sample(OURS, way, {"readers": READERS, "of": which}, [np.quantile(values, 0.99).item()])

    entries = [Entry(OURS, partial(measure, which)) for which in BUFFERS]
    run.race("load", entries, run.sizes.load_rounds)


def _messages_beside_readers(run: Run, loaded: Process, publisher: Process) -> None:
    messages = run.sizes.load_messages

    def measure() -> Iterator[Sample]:
        with _receiving(loaded, publisher, "this", DEPTH) as before:
            with _readers(loaded, "this"):
                publisher.ask("start", RATE, 1, messages)
                publisher.ask("finish")
            lost = messages - (loaded.ask("received", "this")["received"] - before)
        labels = {"readers": READERS, "of": "this", "messages": messages}
        yield Sample(OURS, LOST, labels, [lost], "messages")

    run.say(f"load: {messages} messages at {RATE} Hz beside {READERS} readers")
    run.race("load", [Entry(OURS, measure)], rounds=1)


def _race_beside_messages(run: Run, loaded: Process, publisher: Process) -> None:
    seconds = run.sizes.load_s

    def measure(transforms: int, rate: int, which: str) -> Iterator[Sample]:
        run.say(f"load: lookups beside {rate} messages/s of {transforms} into {which} buffer")
        with _receiving(loaded, publisher, which, rate):
            publisher.ask("start", rate, transforms, round(rate * seconds))
            lookups = loaded.ask("probe", "lookup_transform", seconds)["ns"]
            publisher.ask("finish")
        labels = {"transforms": transforms, "Hz": rate, "into": which}
        yield Sample(OURS, LOOKUP, labels, [np.quantile(lookups, 0.999).item()])

    for transforms, rate in HEAVY.items():
        arguments = [(transforms, rate, which) for which in BUFFERS]
        entries = [Entry(OURS, partial(measure, *own)) for own in arguments]
        run.race("load", entries, run.sizes.load_rounds)


@contextmanager
def _readers(loaded: Process, which: str) -> Iterator[list[float]]:
    """Threads in vector lookups; afterwards the list holds by how many ns sleeps were late."""
    late: list[float] = []
    loaded.ask("read", which, READERS)
    try:
        yield late
    finally:
        answer = loaded.ask("stop")
    if not answer["read"]:
        raise Failure("the readers have read nothing")
    late += answer["late"]


@contextmanager
def _receiving(loaded: Process, publisher: Process, which: str, depth: int) -> Iterator[int]:
    """A listener that the publisher has discovered; how many transforms its buffer received before."""
    before = loaded.ask("receive", which, depth)["received"]
    try:
        publisher.ask("discover", 1)
        yield before
    finally:
        loaded.ask("stop_listening")
    publisher.ask("discover", 0)


def receive(run: Run) -> None:
    """CPU of a listening process, and the time from the sending of a message to a waiting lookup's answer."""
    paths = {OURS: OUR_PATHS, "ros2": UPSTREAM_PATHS if "ros2" in run.libraries else ()}
    contenders = [(who, path) for who, own in paths.items() for path in own]
    with run.process("publishing.py") as publisher:
        entries = [Entry(who, partial(_receive, run, publisher, who, path)) for who, path in contenders]
        run.race("receive", entries, run.sizes.receive_rounds)


def _receive(run: Run, publisher: Process, who: str, path: str) -> Iterator[Sample]:
    sizes = run.sizes
    run.say(f"receive: {run.libraries[who].title}, {path}")
    with run.process("listening.py", path, who=who) as listener:
        publisher.ask("discover", 1)
        publish(publisher, listener, max(RECEIVED), max(RECEIVED.values()), sizes.receive_filling)
        # The largest messages first: every frame has a full history then, the few of the others, too.
        for transforms, rate in sorted(RECEIVED.items(), reverse=True):
            labels = {"transforms": transforms, "Hz": rate}
            before = listener.ask("cost")
            messages = round(rate * sizes.receive_s)
            publish(publisher, listener, transforms, rate, messages)
            after = listener.ask("cost")
            yield Sample(who, path, labels, [(after["cpu_ns"] - before["cpu_ns"]) / messages])
            own_ns, own_ns_before = (cost["threads"].get(RECEIVER_THREAD, 0) for cost in (after, before))
            if own_ns > own_ns_before:  # it may be there for static transforms alone
                yield Sample(who, f"{path}, its thread", labels, [(own_ns - own_ns_before) / messages])
        if path in WAKING:
            for how in ("block", "poll") if who == OURS else ("block",):
                first = publisher.ask("start", WAKE_RATE, 1, sizes.receive_wakes)["next"]
                answers = listener.ask("look", first, sizes.receive_wakes, how)["ns"]
                publisher.ask("finish")
                yield Sample(who, f"{path}, {how}", {"Hz": WAKE_RATE}, answers)
    publisher.ask("discover", 0)


def publish(publisher: Process, listener: Process, transforms: int, rate: int, messages: int) -> None:
    first = publisher.ask("start", rate, transforms, messages)["next"]
    publisher.ask("finish")
    if not listener.ask("arrived", first + messages - 1)["arrived"]:
        raise Failure(f"the last of {messages} messages did not arrive")
