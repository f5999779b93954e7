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

import statistics
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from bench.inserts import BESIDE_WAITERS, INTO, KINDS
from bench.lookups import FAILING_WAYS, REASONS
from bench.nodes import BUFFERS, HEAVY, INSERT, LATE, LOOKUP, LOST, RECEIVED
from bench.race import OURS, Row, Rows

PASS, SHORT, UNKNOWN = "pass", "falls short", "not measured"
CHAIN = "chain of 1000"

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
TYPES_WANTED = {"point": 30, "vector": 30, "pose": 30, "pose with covariance": 20, "polygon of 100": 100}
RECEIVE_WANTED = {1: 8, 50: 20}
GROWTH_WANTED = {"samples": 1.5, "frames": 1.2, "ancestors": 1.1}
GROWTH_WAYS = {
    ("buffer", "few"): "Buffer.lookup_transform",
    ("buffer", "many"): "Buffer.lookup_transform, all pairs in turn",
    ("vector", "few"): "lookup_transforms, sorted times",
}

Values = Iterable[tuple[str, float | None]]  # of cells by name; None: something to compare with is missing


@dataclass
class Verdict:
    """One line of a target: what was measured in the worst cell, beside what is wanted."""

    target: str
    what: str
    wanted: str
    measured: str
    verdict: str


def verdicts(rows: Rows) -> list[Verdict]:
    parts = _lookups, _vectors, _growth, _inserts, _memory, _load, _waiters, _receive, _types
    return [verdict for part in parts for verdict in part(rows)]


def at_least(target: str, what: str, values: Values, limit: float, unit: str = "x") -> Verdict:
    return _verdict(target, what, values, limit, unit, sign=1)


def at_most(target: str, what: str, values: Values, limit: float, unit: str = "x") -> Verdict:
    return _verdict(target, what, values, limit, unit, sign=-1)


def _verdict(target: str, what: str, values: Values, limit: float, unit: str, sign: int) -> Verdict:
    wanted = f"at {'least' if sign > 0 else 'most'} {limit:.3g}{unit}"
    known = [(sign * value, name) for name, value in values if value is not None]
    if not known:
        return Verdict(target, what, wanted, "nothing to compare with", UNKNOWN)
    value, name = min(known)
    verdict = PASS if value >= sign * limit else SHORT
    return Verdict(target, what, wanted, f"{sign * value:,.3g}{unit}, worst: {name}", verdict)


def cpp_factor(rows: Rows) -> float | None:
    """What Debian's C++ takes here over what it took there; None where it was not measured."""
    return _factor(rows, "ros1_cpp", DEBIAN_CPP)


def python_factor(rows: Rows) -> float | None:
    """The same of Debian's Python."""
    return _factor(rows, "ros1_py", DEBIAN_CORE)


def _factor(rows: Rows, who: str, there: Mapping[str, int]) -> float | None:
    here = {place: _ns(rows.find("lookups", who, "core", tree=CHAIN, place=place)) for place in there}
    found = [ns / there[place] for place, ns in here.items() if ns is not None]
    return statistics.median(found) if found else None


def _ns(row: Row | None) -> float | None:
    return None if row is None else row.median


def _times(value: float | None, factor: float | None) -> float | None:
    return None if value is None or factor is None else value * factor


def _ratio(above: float | None, below: float | None) -> float | None:
    return None if above is None or below is None else above / below


def _ratio_in_race(above: Row | None, below: Row | None) -> float | None:
    return None if above is None or below is None else above.ratio_to(below)


def _cell(rows: Rows, who: str, way: str, cell: Cell, section: str = "lookups") -> float | None:
    """The median of a cell of the published table, in the smallest tree that has it."""
    place, hops = cell
    return _ns(rows.find(section, who, way, place=place, hops=hops))


def _name(cell: Cell) -> str:
    return f"{cell[0]}, {cell[1]} hop{'s' * (cell[1] > 1)}"


def _lookups(rows: Rows) -> Iterable[Verdict]:
    own = {cell: _cell(rows, OURS, "buffer", cell) for cell in JAZZY_CPP}
    cpp = {cell: _times(ns, cpp_factor(rows)) for cell, ns in JAZZY_CPP.items()}
    python = {cell: _times(ns, python_factor(rows)) for cell, ns in JAZZY_BUFFER.items()}

    def against(their: Callable[[Cell], float | None]) -> Values:
        return [(_name(cell), _ratio(their(cell), own[cell])) for cell in own]

    what = "Buffer.lookup_transform against {}, nine cells"
    if any(row.who == "ros2" for row in rows):
        sourced = against(lambda cell: _cell(rows, "ros2", "buffer", cell))
        yield at_least("lookup-vs-sourced-python", what.format("the sourced ROS 2's Buffer"), sourced, 15)
    else:
        debian = against(lambda cell: _cell(rows, "ros1_py", "core", cell))
        peer = "Debian's core (for 15x Jazzy's Buffer)"
        yield at_least("lookup-vs-debian-python", what.format(peer), debian, 5)
        peer = "Jazzy's Buffer (carried over)"
        yield at_least("lookup-vs-jazzy-python", what.format(peer), against(python.get), 15)
    past = [(_name(cell), _ratio(cpp[cell], own[cell])) for cell in cpp if cell[0] == "past"]
    others = [(_name(cell), _ratio(own[cell], cpp[cell])) for cell in cpp if cell[0] != "past"]
    yield at_least("past-lookup-vs-cpp", "against Jazzy's C++ (carried over), past times", past, 1)
    what = "time over Jazzy's C++ (carried over), static and latest"
    yield at_most("latest-lookup-vs-cpp", what, others, 3.5)
    ours, theirs = (
        _ns(rows.find("lookups", who, way, tree=CHAIN, place="random"))
        for who, way in ((OURS, "buffer"), ("schiebung", "core"))
    )
    what = "time over schiebung's, 4 dynamic hops, random times"
    yield at_most("lookup-vs-schiebung", what, [(CHAIN, _ratio(ours, theirs))], 1)


def _vectors(rows: Rows) -> Iterable[Verdict]:
    factor = cpp_factor(rows)
    past: list[tuple[str, float | None]] = []
    others: list[tuple[str, float | None]] = []
    for (place, hops), ns in JAZZY_CPP.items():
        for times in ("sorted", "random") if place == "past" else (place,):
            own = _cell(rows, OURS, "vector", (times, hops), "vectors")
            value = _name((times, hops)), _ratio(_times(ns, factor), own)
            (past if place == "past" else others).append(value)
    chains = [
        (place, _ratio(_ns(rows.find("vectors", OURS, "vector", tree=CHAIN, place=place)), 1e3))
        for place in ("sorted", "random")
    ]
    what = "lookup_transforms per transform against one of Jazzy's C++ (carried over)"
    yield at_least("latest-vector-vs-cpp", f"{what}, static and latest", others, 2)
    yield at_least("past-vector-vs-cpp", f"{what}, past times", past, 8)
    what = "4 dynamic hops, 1000 samples (0.1 us carried over)"
    yield at_most("vector-time", what, chains, 0.1 * (factor or 1), " us")
    gain = _ns(rows.find("vectors", OURS, "threads", tree=CHAIN))
    yield at_least("vector-threads", "two threads against one", [(CHAIN, gain)], 1.8)


def _growth(rows: Rows) -> Iterable[Verdict]:
    for axis, limit in GROWTH_WANTED.items():
        for (way, pairs), what in GROWTH_WAYS.items():
            own = rows.all("growth", OURS, way, axis=axis, pairs=pairs)
            if own:
                values = [(f"{row.labels['value']:,}", row.median / own[0].median) for row in own[1:]]
                span = f"{own[0].labels['value']:,} to {own[-1].labels['value']:,}"
                yield at_most(f"growth-with-{axis}", f"{what}: {span} {axis}", values, limit)


def _inserts(rows: Rows) -> Iterable[Verdict]:
    own = _ns(rows.find("inserts", OURS, "set_transform"))
    peer, title = _ns(rows.find("inserts", "ros2", "set_transform")), "the sourced ROS 2's"
    if peer is None:
        peer, title = _times(JAZZY_SET_TRANSFORM, python_factor(rows)), "Jazzy's Python (carried over)"
    values = [("full histories", _ratio(peer, own))]
    yield at_least("insert-vs-python", f"set_transform against {title}", values, 7)
    serialised = [("messages of 50", _ratio(_ns(rows.find("inserts", OURS, "set_transforms_cdr")), 1e3))]
    yield at_most("insert-serialised", "set_transforms_cdr, per transform", serialised, 0.15, " us")
    alone, *beside = rows.all("inserts", OURS, BESIDE_WAITERS) or [None]
    slower = [
        (f"{row.labels['waiters']:,} waiting for {row.labels['waiting_for']}", _ratio(row.median, _ns(alone)))
        for row in beside
    ]
    yield at_most("insert-beside-futures", "insert with pending waiters over one with none", slower, 1.2)


def _memory(rows: Rows) -> Iterable[Verdict]:
    for way, limit in ("fullest", 72), ("just grown", 110):
        row = rows.find("memory", OURS, f"ring, {way}")
        # Rounded: names and tables are in it, too, less than half a byte for each of so many samples.
        values = [] if row is None else [(f"{row.labels['samples']:,} samples", round(row.median))]
        yield at_most("memory-per-sample", f"memory per sample, ring, {way}", values, limit, " bytes")


def _load(rows: Rows) -> Iterable[Verdict]:
    beside = "beside 4 threads in vector lookups"
    lost = _ns(rows.find("load", OURS, LOST))
    yield at_most("load-lost", f"messages lost {beside}", [("100 Hz", lost)], 0, "")
    insert = _ratio(_ns(rows.find("load", OURS, INSERT, of="this")), 1e6)
    yield at_most("load-insert", f"insert {beside}, 99th percentile", [("one buffer", insert)], 1, " ms")
    late = _ratio_in_race(*(rows.find("load", OURS, LATE, of=which) for which in BUFFERS))
    what = f"sleep {beside}: how late, over another buffer"
    yield at_most("load-sleep", what, [("1 ms, 99th", late)], 1.1)  # nothing but the machine's noise
    delays = []
    for transforms, rate in HEAVY.items():
        this, other = (_ns(rows.find("load", OURS, LOOKUP, transforms=transforms, into=b)) for b in BUFFERS)
        above = None if this is None or other is None else (this - other) / 1e6
        delays.append((f"{rate:,} messages/s of {transforms:,}", above))
    what = "lookup beside messages, 99.9th percentile above another buffer's"
    yield at_most("load-lookup", what, delays, 0.2, " ms")


def _waiters(rows: Rows) -> Iterable[Verdict]:
    beside = []
    for kind in KINDS:
        for into in INTO:
            alone, waiting = rows.all("waiters", OURS, into, waiting_for=kind) or (None, None)
            beside.append((f"{kind}, into {into}", _ratio_in_race(waiting, alone)))
    yield at_most("insert-beside-waiters", "insert that answers no waiter over one beside none", beside, 1.2)
    fails = []
    for way in FAILING_WAYS:
        for reason in REASONS:
            small, large = rows.all("failing", OURS, way, reason=reason) or (None, None)
            fails.append((f"{way}, {reason}", _ratio_in_race(large, small)))
    yield at_most("failing-lookup", "lookup that fails, in a large tree over in a small one", fails, 1.2)


def _receive(rows: Rows) -> Iterable[Verdict]:
    def at(who: str, path: str, transforms: int) -> Row | None:
        return rows.find("receive", who, path, transforms=transforms)

    for transforms in RECEIVED:
        own, upstream = at(OURS, "listener", transforms), at("ros2", "listener", transforms)
        less = _ratio_in_race(upstream, own)
        peer, wanted = "the sourced ROS 2's", RECEIVE_WANTED[transforms]
        if upstream is None:
            less, peer = _ratio(JAZZY_RECEIVE[transforms], _ns(own)), "Jazzy's Python (published)"
        name = f"{transforms} transforms"
        yield at_least("receive-vs-python", f"CPU per message against {peer}", [(name, less)], wanted)
        floor = _ratio_in_race(own, at(OURS, "floor", transforms))
        yield at_most("receive-vs-floor", "CPU per message over dropping its bytes", [(name, floor)], 1.3)
    spinning = _ratio_in_race(at(OURS, "spin_once", 1), at("ros2", "spin_once", 1))
    what = "CPU per message in a loop of spin_once over the sourced ROS 2's"
    yield at_most("spin-once", what, [("1 transform", spinning)], 0.75)
    block, poll = (rows.find("receive", OURS, f"listener, {how}") for how in ("block", "poll"))
    wake = None if block is None or poll is None else (block.median - poll.median) / 1e6
    what = "wake-up of a waiting lookup, later than one that polls (medians)"
    yield at_most("wake-up latency", what, [("100 Hz", wake)], 0.2, " ms")
    slowest = None if block is None else block.p95 / 1e6
    what = "wake-up, from the sending of the message, 95th percentile"
    yield at_most("wake-up latency", what, [("100 Hz", slowest)], 1, " ms")


def _types(rows: Rows) -> Iterable[Verdict]:
    factor = python_factor(rows)
    for name, wanted in TYPES_WANTED.items():
        own = _ns(rows.find("types", OURS, "call", type=name))
        value = _ratio(_times(JAZZY_TYPES.get(name), factor), own)
        yield at_least("types-vs-python", f"do_transform of a {name} against Jazzy's (carried over)",
                       [(name, value)], wanted)  # fmt: skip
