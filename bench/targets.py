"""
Owns the targets of speed and memory: what is wanted, beside what was measured.

They are ratios to tf2 of ROS 2 Jazzy: of a sourced ROS 2 where it takes part. Elsewhere Jazzy's figures of
one machine are carried over to this one. Debian's tf2 was measured beside Jazzy's there, once. Here it is
measured beside ours, and what it takes here over what it took there is the factor. Jazzy's `Buffer` takes 3.1
times what Debian's `lookup_transform_core` takes on 4 hops at recent times, so 15 times Jazzy's is 5 times
Debian's. In deep history Debian's search is faster than Jazzy's: there, 5 times Debian's demands more than
15 times Jazzy's.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from bench.inserts import BESIDE_WAITERS, waiters_ratios
from bench.lookups import FAILING_WAYS, REASONS
from bench.nodes import BUFFERS, HEAVY, INSERT, LATE, LOOKUP, LOST, RATE, READERS
from bench.programs import LISTENER, WATCHING
from bench.race import OURS, Row, Rows, ratio_of_rounds
from bench.recordings import BATCH, LOAD, PICKLE, RAW
from bench.shared import (
    ATTACH,
    ATTACHED,
    BLOCK,
    FIRST_ATTACH,
    INSERTS,
    NOW,
    PAST,
    PRIVATE,
    RESTS,
    VECTOR,
    nodes_ratios,
)

PASS, SHORT, UNKNOWN = "pass", "falls short", "not measured"
CHAIN = "chain of 1000"
MILLION = 1_000_000

# What Jazzy's tf2 takes on the machine where Debian's took the figures below, in ns.
Cell = tuple[str, int]  # place, hops
JAZZY_CPP: dict[Cell, int] = {
    ("static", 1): 160, ("static", 4): 400, ("static", 10): 510,
    ("past", 1): 1700, ("past", 4): 4300, ("past", 10): 5900,
    ("latest", 1): 170, ("latest", 4): 360, ("latest", 10): 440,
}  # fmt: skip
JAZZY_BUFFER: dict[Cell, int] = {
    ("static", 1): 10_500, ("static", 4): 11_600, ("static", 10): 12_200,
    ("past", 1): 13_100, ("past", 4): 18_100, ("past", 10): 21_700,
    ("latest", 1): 10_400, ("latest", 4): 10_900, ("latest", 10): 11_200,
}  # fmt: skip
JAZZY_SET_TRANSFORM = 2700
JAZZY_RECEIVE = {1: 214_000, 50: 1_139_000}  # CPU per message of so many transforms
JAZZY_TYPES = {"point": 22_700, "pose": 33_500, "pose with covariance": 57_000, "polygon of 100": 2_638_000}
# Debian's there: 4 dynamic hops, 1000 samples per frame, by place.
DEBIAN_CPP = {"newest": 580, "random": 690, "oldest": 590}
DEBIAN_CORE = {"newest": 3500}

# How often ours is to fit into the time of the other.
TYPES_WANTED = {30: ("point", "pose"), 20: ("pose with covariance",), 100: ("polygon of 100",)}
RECEIVE_WANTED = {1: 8, 50: 20}
GROWTH_WANTED = {"samples": 1.5, "frames": 1.2, "ancestors": 1.1}
GROWTH_WAYS = {
    ("buffer", "few"): "Buffer.lookup_transform",
    ("buffer", "many"): "Buffer.lookup_transform, all pairs in turn",
    ("vector", "few"): "lookup_transforms, sorted times",
}


@dataclass
class Verdict:
    """One line of a target: what was measured in the worst cell, beside what is wanted."""

    target: str
    what: str
    wanted: str
    measured: str
    verdict: str


def verdicts(rows: Rows) -> list[Verdict]:
    parts = (
        _lookups,
        _vectors,
        _growth,
        _inserts,
        _memory,
        _load,
        _waiters,
        _receive,
        _shared,
        _watch,
        _types,
        _recordings,
    )
    return [verdict for part in parts for verdict in part(rows)]


def at_least(
    target: str, what: str, values: Mapping[str, float], limit: float, unit: str = "x", sign: int = 1
) -> Verdict:
    """By the worst of the values, which are by cell; NaN where there is nothing to compare with."""
    wanted = f"at {'least' if sign > 0 else 'most'} {limit:.3g}{unit}"
    known = [(sign * value, name) for name, value in values.items() if not math.isnan(value)]
    if not known:
        return Verdict(target, what, wanted, "nothing to compare with", UNKNOWN)
    value, name = min(known)
    verdict = PASS if value >= sign * limit else SHORT
    return Verdict(target, what, wanted, f"{sign * value:,.3g}{unit}, worst: {name}", verdict)


def at_most(target: str, what: str, values: Mapping[str, float], limit: float, unit: str = "x") -> Verdict:
    return at_least(target, what, values, limit, unit, sign=-1)


def cpp_factor(rows: Rows) -> float:
    """What Debian's C++ takes here over what it took there; NaN where it was not measured."""
    return _factor(rows, "ros1_cpp", DEBIAN_CPP)


def python_factor(rows: Rows) -> float:
    """The same of Debian's Python."""
    return _factor(rows, "ros1_py", DEBIAN_CORE)


def _factor(rows: Rows, who: str, there: Mapping[str, int]) -> float:
    return statistics.median(
        rows.median("lookups", who, "core", tree=CHAIN, place=place) / ns for place, ns in there.items()
    )


def _cell(rows: Rows, who: str, way: str, cell: Cell, section: str = "lookups") -> float:
    """The median of a cell of the published table, in the smallest tree that has it."""
    return rows.median(section, who, way, place=cell[0], hops=cell[1])


def _name(cell: Cell) -> str:
    return f"{cell[0]}, {cell[1]} hop{'s' * (cell[1] > 1)}"


def _lookups(rows: Rows) -> Iterable[Verdict]:
    own = {cell: _cell(rows, OURS, "buffer", cell) for cell in JAZZY_CPP}
    cpp = {cell: ns * cpp_factor(rows) for cell, ns in JAZZY_CPP.items()}

    def against(target: str, peer: str, their_ns: Callable[[Cell], float], limit: float) -> Verdict:
        what = f"Buffer.lookup_transform against {peer}, nine cells"
        return at_least(target, what, {_name(cell): their_ns(cell) / own[cell] for cell in own}, limit)

    if any(row.who == "ros2" for row in rows):
        peer = "the sourced ROS 2's Buffer"
        yield against("lookup-vs-sourced-python", peer, lambda cell: _cell(rows, "ros2", "buffer", cell), 15)
    else:
        peer = "Debian's core (for 15x Jazzy's Buffer)"
        yield against("lookup-vs-debian-python", peer, lambda cell: _cell(rows, "ros1_py", "core", cell), 5)
        peer, factor = "Jazzy's Buffer (carried over)", python_factor(rows)
        yield against("lookup-vs-jazzy-python", peer, lambda cell: JAZZY_BUFFER[cell] * factor, 15)
    past = {_name(cell): cpp[cell] / own[cell] for cell in cpp if cell[0] == "past"}
    yield at_least("past-lookup-vs-cpp", "against Jazzy's C++ (carried over), past times", past, 1)
    others = {_name(cell): own[cell] / cpp[cell] for cell in cpp if cell[0] != "past"}
    what = "time over Jazzy's C++ (carried over), static and latest"
    yield at_most("latest-lookup-vs-cpp", what, others, 3.5)
    ours, schiebung = (
        rows.median("lookups", who, way, tree=CHAIN, place="random")
        for who, way in ((OURS, "buffer"), ("schiebung", "core"))
    )
    what = "time over schiebung's, 4 dynamic hops, random times"
    yield at_most("lookup-vs-schiebung", what, {CHAIN: ours / schiebung}, 1)


def _vectors(rows: Rows) -> Iterable[Verdict]:
    factor = cpp_factor(rows)
    past: dict[str, float] = {}
    others: dict[str, float] = {}
    for (place, hops), ns in JAZZY_CPP.items():
        for times in ("sorted", "random") if place == "past" else (place,):
            own = _cell(rows, OURS, "vector", (times, hops), "vectors")
            (past if place == "past" else others)[_name((times, hops))] = ns * factor / own
    what = "lookup_transforms per transform against one of Jazzy's C++ (carried over)"
    yield at_least("latest-vector-vs-cpp", f"{what}, static and latest", others, 2)
    yield at_least("past-vector-vs-cpp", f"{what}, past times", past, 8)
    us = {p: rows.median("vectors", OURS, "vector", tree=CHAIN, place=p) / 1e3 for p in ("sorted", "random")}
    limit_us = 0.1 if math.isnan(factor) else 0.1 * factor
    yield at_most("vector-time", "4 dynamic hops, 1000 samples (0.1 us carried over)", us, limit_us, " us")
    gain = rows.median("vectors", OURS, "threads", tree=CHAIN)
    yield at_least("vector-threads", "two threads against one", {CHAIN: gain}, 1.8)


def _growth(rows: Rows) -> Iterable[Verdict]:
    for axis, limit in GROWTH_WANTED.items():
        for (way, pairs), what in GROWTH_WAYS.items():
            own = rows.all("growth", OURS, way, axis=axis, pairs=pairs)
            if own:
                values = {f"{row.labels['value']:,}": row.median / own[0].median for row in own[1:]}
                span = f"{own[0].labels['value']:,} to {own[-1].labels['value']:,}"
                yield at_most(f"growth-with-{axis}", f"{what}: {span} {axis}", values, limit)


def _inserts(rows: Rows) -> Iterable[Verdict]:
    own = rows.median("inserts", OURS, "set_transform")
    peer, title = rows.median("inserts", "ros2", "set_transform"), "the sourced ROS 2's"
    if math.isnan(peer):
        peer, title = JAZZY_SET_TRANSFORM * python_factor(rows), "Jazzy's Python (carried over)"
    yield at_least("insert-vs-python", f"set_transform against {title}", {"full histories": peer / own}, 7)
    us = rows.median("inserts", OURS, "set_transforms_cdr") / 1e3
    yield at_most(
        "insert-serialised", "set_transforms_cdr, per transform", {"messages of 50": us}, 0.15, " us"
    )
    alone = rows.median("inserts", OURS, BESIDE_WAITERS, waiters=0)
    slower = {
        f"{row.labels['waiters']:,} waiting for {row.labels['waiting_for']}": row.median / alone
        for row in rows.all("inserts", OURS, BESIDE_WAITERS)
        if row.labels["waiters"]
    }
    yield at_most("insert-beside-futures", "insert with pending waiters over one with none", slower, 1.2)


def _memory(rows: Rows) -> Iterable[Verdict]:
    for way, limit in ("fullest", 72), ("just grown", 110):
        # Rounded: names and tables are in it, too, less than half a byte for each of so many samples.
        values = {
            f"{row.labels['samples']:,} samples": float(round(row.median))
            for row in rows.all("memory", OURS, f"ring, {way}")
        }
        yield at_most("memory-per-sample", f"memory per sample, ring, {way}", values, limit, " bytes")


def _load(rows: Rows) -> Iterable[Verdict]:
    beside = f"beside {READERS} threads in vector lookups"
    lost = rows.median("load", OURS, LOST)
    yield at_most("load-lost", f"messages lost {beside}", {f"{RATE} Hz": lost}, 0, "")
    insert = rows.median("load", OURS, INSERT, of="this") / 1e6
    yield at_most("load-insert", f"insert {beside}, 99th percentile", {"one buffer": insert}, 1, " ms")
    late = ratio_of_rounds(*(rows.find("load", OURS, LATE, of=buffer) for buffer in BUFFERS))
    what = f"sleep {beside}: how late, over another buffer"
    yield at_most("load-sleep", what, {"1 ms, 99th": late}, 1.1)  # nothing but the machine's noise
    delays_ms = {}
    for transforms, rate in HEAVY.items():
        this, other = (
            rows.median("load", OURS, LOOKUP, transforms=transforms, into=buffer) for buffer in BUFFERS
        )
        delays_ms[f"{rate:,} messages/s of {transforms:,}"] = (this - other) / 1e6
    what = "lookup beside messages, 99.9th percentile above another buffer's"
    yield at_most("load-lookup", what, delays_ms, 0.2, " ms")


def _waiters(rows: Rows) -> Iterable[Verdict]:
    beside = {
        f"{kind}, into {into}": ratio
        for kind, ratios in waiters_ratios(rows).items()
        for into, ratio in ratios.items()
    }
    yield at_most("insert-beside-waiters", "insert that answers no waiter over one beside none", beside, 1.2)
    fails = {}
    for way, reason in itertools.product(FAILING_WAYS, REASONS):
        small, large = rows.all("failing", OURS, way, reason=reason) or (None, None)
        fails[f"{way}, {reason}"] = ratio_of_rounds(large, small)
    yield at_most("failing-lookup", "lookup that fails, in a large tree over in a small one", fails, 1.2)


def _receive(rows: Rows) -> Iterable[Verdict]:
    def at(who: str, path: str, transforms: int) -> Row | None:
        return rows.find("receive", who, path, transforms=transforms)

    for transforms, wanted in RECEIVE_WANTED.items():
        name, own = f"{transforms} transforms", at(OURS, "listener", transforms)
        peer, less = "the sourced ROS 2's", ratio_of_rounds(at("ros2", "listener", transforms), own)
        if own and math.isnan(less):
            peer, less = "Jazzy's Python (published)", JAZZY_RECEIVE[transforms] / own.median
        yield at_least("receive-vs-python", f"CPU per message against {peer}", {name: less}, wanted)
        floor = ratio_of_rounds(own, at(OURS, "floor", transforms))
        yield at_most("receive-vs-floor", "CPU per message over dropping its bytes", {name: floor}, 1.3)
    spinning = ratio_of_rounds(at(OURS, "spin_once", 1), at("ros2", "spin_once", 1))
    what = "CPU per message in a loop of spin_once over the sourced ROS 2's"
    yield at_most("spin-once", what, {"1 transform": spinning}, 0.75)
    block, poll = (rows.find("receive", OURS, f"listener, {how}") for how in ("block", "poll"))
    later_ms = (block.median - poll.median) / 1e6 if block and poll else math.nan
    what = "wake-up of a waiting lookup, later than one that polls (medians)"
    yield at_most("wake-up latency", what, {"100 Hz": later_ms}, 0.2, " ms")
    slowest_ms = block.p95 / 1e6 if block else math.nan
    what = "wake-up, from the sending of the message, 95th percentile"
    yield at_most("wake-up latency", what, {"100 Hz": slowest_ms}, 1, " ms")


def _shared(rows: Rows) -> Iterable[Verdict]:
    def ratio(**labels: str) -> float:
        return ratio_of_rounds(*(rows.find("shared", OURS, which, **labels) for which in (ATTACHED, PRIVATE)))

    what = "{} of a shared buffer over a private one's"
    single = {
        f"{call}, owner {does}": ratio(call=call, owner=does)
        for call in (PAST, NOW)
        for does in (RESTS, INSERTS)
    }
    yield at_most("shared-lookup", what.format("lookup_transform"), single, 1.2)
    vector = {f"owner {does}": ratio(call=VECTOR, owner=does) for does in (RESTS, INSERTS)}
    yield at_most("shared-vector", what.format("lookup_transforms"), vector, 1.1)
    wait_ms = {"median": rows.median("shared", OURS, BLOCK) / 1e6}
    to = "insert until a lookup that waits in another process returns"
    yield at_most("shared-wait", to, wait_ms, 0.3, " ms")
    memory = {kind: ratio(memory=kind) for kind in ("private", "Pss")}
    yield at_most("shared-memory", what.format("memory of a reader"), memory, 1)
    attach_ms = {way: rows.median("shared", OURS, way) / 1e6 for way in (ATTACH, FIRST_ATTACH)}
    yield at_most("shared-attach", "Buffer(attach=...)", attach_ms, 20, " ms")
    what = "CPU of attached nodes and their owner over one that listens"
    yield at_most("shared-nodes", what, nodes_ratios(rows), 1.5)


def _watch(rows: Rows) -> Iterable[Verdict]:
    def at(way: str) -> Row | None:
        return rows.find("watch", OURS, way)

    ratios = {way: ratio_of_rounds(at(way), at(LISTENER)) for way in WATCHING if way != LISTENER}
    yield at_most("watch-vs-listener", "CPU of tf2_monitor and tf2_check over a listener's", ratios, 2)


def _types(rows: Rows) -> Iterable[Verdict]:
    factor = python_factor(rows)
    for wanted, names in TYPES_WANTED.items():
        own = {name: rows.median("types", OURS, "call", type=name) for name in names}
        values = {name: JAZZY_TYPES[name] * factor / ns for name, ns in own.items()}
        what = f"do_transform of {' and '.join(names)} against Jazzy's (carried over)"
        yield at_least("types-vs-python", what, values, wanted)


def _recordings(rows: Rows) -> Iterable[Verdict]:
    above_us = {}
    for own in rows.all("recordings", OURS, LOAD):
        raw = rows.find("recordings", OURS, RAW, **own.labels)
        if raw is not None:
            name = f"{own.labels['per message']} a message, {own.labels['compression']}"
            above_us[name] = statistics.median(
                (a - b) / 1e3 for a, b in zip(own.rounds, raw.rounds, strict=True)
            )
    what = "bag.load per transform, above rosbags' raw messages"
    yield at_most("recording-load", what, above_us, 0.2, " us")
    pickles = [row for way in PICKLE for row in rows.all("recordings", OURS, way)]
    seconds = {row.way: row.median / 1e9 * MILLION / row.labels["samples"] for row in pickles}
    what = "a pickle of a million samples, and back"
    yield at_most("recording-pickle", what, seconds, 0.25, " s")
    # Of recordings that take a second or more: starting a worker takes about as long as a short one.
    one, two = (
        rows.median("recordings", OURS, BATCH, transforms=MILLION, workers=workers) for workers in (1, 2)
    )
    what = "recordings per second by two workers over one"
    yield at_least("recording-workers", what, {BATCH: two / one}, 1.8)
