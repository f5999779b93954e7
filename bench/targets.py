"""
Compare what was measured with the targets of speed and memory.

They are ratios to tf2 of ROS 2 Jazzy. For Python, that is the sourced ROS 2. For C++, Jazzy's figures of one
machine are carried over to this one: Debian's tf2 was measured beside Jazzy's there, once. Here it is
measured beside ours, and what it takes here over what it took there is the factor.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from bench import receiving
from bench.inserts import BESIDE_WAITERS
from bench.race import OURS, Row, Rows, difference_of_rounds, p99, ratio_of_rounds
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
    looking_us,
    nodes_ratio,
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
# Debian's there: 4 dynamic hops, 1000 samples per frame, by place.
DEBIAN_CPP = {"newest": 580, "random": 690, "oldest": 590}

# How often ours is to fit into the time of the other.
RECEIVE_WANTED = {1: 6, 50: 15}
# Over only the subscriptions; and for each transform and listener.
FLOOR_FACTOR, INSERT_NS = 1.25, 200
# Hops: what Jazzy's took over what ours took, in us; ours may take 1.2 times as long as it did.
ONLINE_WANTED = {1: 23.7 / 1.5 / 1.2, 4: 26.3 / 1.9 / 1.2, 10: 29.0 / 2.3 / 1.2}
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
        _online,
        _receiving_cpu,
        _receiving_lookups,
        _losses,
        _shared,
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
    return statistics.median(
        rows.median("lookups", "ros1_cpp", "core", tree=CHAIN, place=place) / ns
        for place, ns in DEBIAN_CPP.items()
    )


def _cell(rows: Rows, who: str, way: str, cell: Cell, section: str = "lookups") -> float:
    """The median of a cell of the published table, in the smallest tree that has it."""
    return rows.median(section, who, way, place=cell[0], hops=cell[1])


def _name(cell: Cell) -> str:
    return f"{cell[0]}, {cell[1]} hop{'s' * (cell[1] > 1)}"


def _lookups(rows: Rows) -> Iterable[Verdict]:
    own = {cell: _cell(rows, OURS, "buffer", cell) for cell in JAZZY_CPP}
    cpp = {cell: ns * cpp_factor(rows) for cell, ns in JAZZY_CPP.items()}

    python = {_name(cell): _cell(rows, "ros2", "buffer", cell) / own[cell] for cell in own}
    what = "Buffer.lookup_transform against the sourced ROS 2's, nine cells"
    yield at_least("lookup-vs-python", what, python, 15)
    past = {_name(cell): cpp[cell] / own[cell] for cell in cpp if cell[0] == "past"}
    yield at_least("past-lookup-vs-cpp", "against Jazzy's C++ (carried over), past times", past, 1)
    others = {_name(cell): own[cell] / cpp[cell] for cell in cpp if cell[0] != "past"}
    what = "time over Jazzy's C++ (carried over), static and latest"
    yield at_most("latest-lookup-vs-cpp", what, others, 3.5)


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
    peer = rows.median("inserts", "ros2", "set_transform")
    what = "set_transform against the sourced ROS 2's"
    yield at_least("insert-vs-python", what, {"full histories": peer / own}, 7)
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


def _online(rows: Rows) -> Iterable[Verdict]:
    for hops, wanted in ONLINE_WANTED.items():
        ros2, own = (rows.find("online", who, "buffer", hops=hops) for who in ("ros2", OURS))
        what = "lookup beside a publisher against the sourced ROS 2's Buffer"
        yield at_least("online-lookup", what, {_name(("online", hops)): ratio_of_rounds(ros2, own)}, wanted)


def _receiving_cpu(rows: Rows) -> Iterable[Verdict]:
    for transforms, wanted in RECEIVE_WANTED.items():
        name = f"{transforms} transforms"
        own, ros2 = (
            rows.find(receiving.SECTION, who, receiving.LISTENER, transforms=transforms, listeners=1)
            for who in (OURS, "ros2")
        )
        what = "CPU per message against the sourced ROS 2's"
        yield at_least("receive-vs-python", what, {name: ratio_of_rounds(ros2, own)}, wanted)
    over_floor = {}
    for listeners, transforms in itertools.product(receiving.LISTENERS, receiving.RECEIVED):
        name = f"{transforms} transforms, {listeners} listeners"
        over_floor[name] = _over_floor(rows, listeners, transforms)
    what = f"CPU per message over {FLOOR_FACTOR} x the subscriptions + {INSERT_NS / 1e3} us per transform"
    yield at_most("receive-vs-floor", what, over_floor, 1)
    what = "CPU per message in a loop of spin_once over the sourced ROS 2's"
    loops = {
        loop: ratio_of_rounds(*(rows.find(receiving.SECTION, who, loop) for who in (OURS, "ros2")))
        for loop in receiving.LOOPS
    }
    yield at_most("spin-once", what, loops, 0.75)


def _over_floor(rows: Rows, listeners: int, transforms: int) -> float:
    own, floor = (
        rows.find(receiving.SECTION, OURS, path, transforms=transforms, listeners=listeners)
        for path in (receiving.LISTENER, receiving.FLOOR)
    )
    if own is None or floor is None:
        return math.nan
    inserts_ns = INSERT_NS * transforms * listeners
    allowed = [FLOOR_FACTOR * floor_ns + inserts_ns for floor_ns in floor.rounds]
    return statistics.median(own_ns / ns for own_ns, ns in zip(own.rounds, allowed, strict=True))


def _receiving_lookups(rows: Rows) -> Iterable[Verdict]:
    def at(way: str, **labels: str) -> Row | None:
        return rows.find(receiving.SECTION, OURS, way, **labels)

    above_ns = difference_of_rounds(
        *(at(p99(receiving.LOOKUP), wait=wait) for wait in (receiving.NO_WAIT, receiving.PENDING_WAIT))
    )
    what = "lookup at 100 Hz, 99th percentile above one whose messages are inserted at once"
    yield at_most("lookup-beside-messages", what, {"50 x 200 Hz": above_ns / 1e6}, 0.15, " ms")
    own_insert_ms = rows.median(receiving.SECTION, OURS, receiving.OWN_INSERT) / 1e6
    what = "from a program's own insert until the lookup that waits for it returns"
    yield at_most("wake-up latency", what, {"median": own_insert_ms}, 0.2, " ms")
    block, poll = at(receiving.BLOCK), at(receiving.POLL)
    later_ms = (block.median - poll.median) / 1e6 if block and poll else math.nan
    what = "wake-up of a waiting lookup, later than one that polls (medians)"
    yield at_most("wake-up latency", what, {"100 Hz": later_ms}, 0.2, " ms")
    slowest_ms = block.p95 / 1e6 if block else math.nan
    what = "wake-up, from the sending of the message, 95th percentile"
    yield at_most("wake-up latency", what, {"100 Hz": slowest_ms}, 1, " ms")


def _losses(rows: Rows) -> Iterable[Verdict]:
    lost = {}
    for beside, flood in receiving.FLOODS.items():
        row = rows.find(receiving.SECTION, OURS, receiving.LOST, beside=beside)
        lost[f"{flood.rate:,} Hz, {beside}"] = math.nan if row is None else max(row.rounds)
    yield at_most("receive-lost", f"messages of {receiving.TRANSFORMS} lost, worst round", lost, 0, "")


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
    yield at_most("shared-memory", what.format("memory of a reader"), memory, 1.1)
    attach_ms = {way: rows.median("shared", OURS, way) / 1e6 for way in (ATTACH, FIRST_ATTACH)}
    yield at_most("shared-attach", "Buffer(attach=...) and its first look", attach_ms, 30, " ms")
    what = "CPU of attached nodes and their owner over one that listens and idle ones"
    yield at_most("shared-nodes", what, {"all": nodes_ratio(rows)}, 1.3)
    what = "CPU of an attached node that looks ten times a second, above one that does not, per transform"
    yield at_most("shared-looking", what, {"all": looking_us(rows)}, 0.25, " µs")


def _recordings(rows: Rows) -> Iterable[Verdict]:
    above_us = {}
    for own in rows.all("recordings", OURS, LOAD):
        raw = rows.find("recordings", OURS, RAW, **own.labels)
        if raw is not None:
            name = f"{own.labels['per message']} a message, {own.labels['compression']}"
            above_us[name] = difference_of_rounds(own, raw) / 1e3
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
