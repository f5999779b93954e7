"""
Owns the targets of speed and memory: what is wanted, beside what was measured.

They are ratios to tf2 of ROS 2 Jazzy: of a sourced ROS 2 where it takes part; see :mod:`bench.jazzy` for the
rest.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from bench import failing, jazzy, load, waiters
from bench.arena import OURS
from bench.jazzy import CHAIN, Cell, carried
from bench.rows import Row, Rows, ratio_by_rounds

PASS, SHORT, UNKNOWN = "pass", "falls short", "not measured"
Values = Iterable[tuple[str, float | None]]  # of cells by name; None: something to compare with is missing

BUFFER_RATIO, DEBIAN_CORE_RATIO = 15.0, 5.0
GROWTH_LIMITS = {"samples": 1.5, "frames": 1.2, "ancestors": 1.1}
GROWTH_WAYS = {
    ("buffer", "few"): "Buffer.lookup_transform",
    ("buffer", "many"): "Buffer.lookup_transform, all pairs in turn",
    ("vector", "few"): "lookup_transforms, sorted times",
}


@dataclass
class Verdict:
    """One line of a target: what was measured in the worst cell, beside what is wanted."""

    target: int
    what: str
    wanted: str
    measured: str
    verdict: str


def verdicts(rows: Rows) -> list[Verdict]:
    return [
        *_lookups(rows),
        *_vectors(rows),
        *_growth(rows),
        *_inserts(rows),
        *_memory(rows),
        *_load(rows),
        *_waiters(rows),
    ]


def at_least(target: int, what: str, values: Values, limit: float, unit: str = "x") -> Verdict:
    return _verdict(target, what, values, limit, unit, sign=1)


def at_most(target: int, what: str, values: Values, limit: float, unit: str = "x") -> Verdict:
    return _verdict(target, what, values, limit, unit, sign=-1)


def _verdict(target: int, what: str, values: Values, limit: float, unit: str, sign: int) -> Verdict:
    wanted = f"at {'least' if sign > 0 else 'most'} {limit:.3g}{unit}"
    known = [(sign * value, name) for name, value in values if value is not None]
    if not known:
        return Verdict(target, what, wanted, "nothing to compare with", UNKNOWN)
    value, name = min(known)
    verdict = PASS if value >= sign * limit else SHORT
    return Verdict(target, what, wanted, f"{sign * value:,.3g}{unit}, worst: {name}", verdict)


def _ratio(above: float | None, below: float | None) -> float | None:
    return None if above is None or below is None else above / below


def _ns(row: Row | None) -> float | None:
    return None if row is None else row.median


def _cell(rows: Rows, who: str, way: str, cell: Cell, section: str = "lookups") -> float | None:
    """The median of a cell of the published table, in the smallest tree that has it."""
    place, hops = cell
    return _ns(rows.find(section, who, way, place=place, hops=hops))


def _name(cell: Cell) -> str:
    return f"{cell[0]}, {cell[1]} hop{'s' * (cell[1] > 1)}"


def _lookups(rows: Rows) -> list[Verdict]:
    own = {cell: _cell(rows, OURS, "buffer", cell) for cell in jazzy.CPP}
    cpp = {cell: carried(ns, jazzy.cpp_factor(rows)) for cell, ns in jazzy.CPP.items()}
    past = [cell for cell in cpp if cell[0] == "past"]
    others = [cell for cell in cpp if cell[0] != "past"]
    chain = {
        who: _ns(rows.find("lookups", who, way, tree=CHAIN, place="random"))
        for who, way in ((OURS, "buffer"), ("schiebung", "core"))
    }
    return [
        *_against_buffer(rows, own),
        at_least(
            1,
            "against Jazzy's C++ (carried over), past times",
            [(_name(cell), _ratio(cpp[cell], own[cell])) for cell in past],
            1.0,
        ),
        at_most(
            1,
            "time over Jazzy's C++ (carried over), static and latest",
            [(_name(cell), _ratio(own[cell], cpp[cell])) for cell in others],
            3.5,
        ),
        at_most(
            1,
            "time over schiebung's, 4 dynamic hops, random times",
            [(CHAIN, _ratio(chain[OURS], chain["schiebung"]))],
            1.0,
        ),
    ]


def _against_buffer(rows: Rows, own: dict[Cell, float | None]) -> list[Verdict]:
    def against(peer: str, their: dict[Cell, float | None], limit: float) -> Verdict:
        values = [(_name(cell), _ratio(their[cell], own[cell])) for cell in own]
        return at_least(1, f"Buffer.lookup_transform against {peer}, nine cells", values, limit)

    if any(row.who == "ros2" for row in rows):
        sourced = {cell: _cell(rows, "ros2", "buffer", cell) for cell in own}
        return [against("the sourced ROS 2's Buffer", sourced, BUFFER_RATIO)]
    core = {cell: _cell(rows, "ros1_py", "core", cell) for cell in own}
    buffer = {cell: carried(ns, jazzy.python_factor(rows)) for cell, ns in jazzy.BUFFER.items()}
    return [
        against("Debian's core (for 15x Jazzy's Buffer)", core, DEBIAN_CORE_RATIO),
        against("Jazzy's Buffer (carried over)", buffer, BUFFER_RATIO),
    ]


def _vectors(rows: Rows) -> list[Verdict]:
    factor = jazzy.cpp_factor(rows)
    still: list[tuple[str, float | None]] = []
    past: list[tuple[str, float | None]] = []
    for (place, hops), ns in jazzy.CPP.items():
        for asked in ("sorted", "random") if place == "past" else (place,):
            own = _cell(rows, OURS, "vector", (asked, hops), "vectors")
            value = _name((asked, hops)), _ratio(carried(ns, factor), own)
            (past if place == "past" else still).append(value)
    chains = [
        (place, _ratio(_ns(rows.find("vectors", OURS, "vector", tree=CHAIN, place=place)), 1e3))
        for place in ("sorted", "random")
    ]
    gain = _ns(rows.find("vectors", OURS, "threads", tree=CHAIN))
    title = "lookup_transforms per transform against one of Jazzy's C++ (carried over)"
    return [
        at_least(2, f"{title}, static and latest", still, 2.0),
        at_least(2, f"{title}, past times", past, 8.0),
        at_most(2, "4 dynamic hops, 1000 samples (0.1 us carried over)", chains, 0.1 * (factor or 1), " us"),
        at_least(2, "two threads against one", [(CHAIN, gain)], 1.8),
    ]


def _growth(rows: Rows) -> list[Verdict]:
    found = []
    for axis, limit in GROWTH_LIMITS.items():
        for (way, pairs), what in GROWTH_WAYS.items():
            own = [row for row in rows if row.section == "growth" and (row.who, row.way) == (OURS, way)]
            own = [row for row in own if (row.labels["axis"], row.labels["pairs"]) == (axis, pairs)]
            if own:
                values = [(f"{row.labels['value']:,}", row.median / own[0].median) for row in own[1:]]
                span = f"{own[0].labels['value']:,} to {own[-1].labels['value']:,}"
                found.append(at_most(3, f"{what}: {span} {axis}", values, limit))
    return found


def _inserts(rows: Rows) -> list[Verdict]:
    own = _ns(rows.find("inserts", OURS, "set_transform"))
    peer, title = _ns(rows.find("inserts", "ros2", "set_transform")), "the sourced ROS 2's"
    if peer is None:
        peer, title = carried(jazzy.SET_TRANSFORM, jazzy.python_factor(rows)), "Jazzy's Python (carried over)"
    serialised = _ratio(_ns(rows.find("inserts", OURS, "set_transforms_cdr")), 1e3)
    alone = _ns(rows.find("inserts", OURS, "set_transform beside waiters", waiters=0))
    slower = [
        (f"{row.labels['waiters']:,} waiting for {row.labels['waiting_for']}", _ratio(row.median, alone))
        for row in rows
        if row.way == "set_transform beside waiters" and row.labels["waiters"]
    ]
    return [
        at_least(4, f"set_transform against {title}", [("full histories", _ratio(peer, own))], 7.0),
        at_most(4, "set_transforms_cdr, per transform", [("messages of 50", serialised)], 0.15, " us"),
        at_most(4, "insert with pending waiters over one with none", slower, 1.2),
    ]


def _memory(rows: Rows) -> list[Verdict]:
    def verdict(way: str, limit: float) -> Verdict:
        row = rows.find("memory", OURS, way)
        values = [] if row is None else [(f"{row.labels['samples']:,} samples", round(row.median))]
        # Rounded: names and tables are in it, too, less than half a byte for each of so many samples.
        return at_most(8, f"memory per sample, {way}", values, limit, " bytes")

    return [verdict("ring, fullest", 72), verdict("ring, just grown", 110)]


def _load(rows: Rows) -> list[Verdict]:
    def found(way: str, **labels: object) -> float | None:
        return _ns(rows.find(load.SECTION, OURS, way, **labels))

    beside = f"beside {load.READERS} threads in vector lookups"
    lost, insert = found(load.LOST), found(load.INSERT, of="this")
    late = [rows.find(load.SECTION, OURS, load.LATE, of=which) for which in load.BUFFERS]
    held_up = []
    for transforms, rate in load.HEAVY.items():
        this, other = (found(load.LOOKUP, transforms=transforms, into=which) for which in load.BUFFERS)
        above = None if this is None or other is None else (this - other) / 1e6
        held_up.append((f"{rate:,} messages/s of {transforms:,}", above))
    return [
        at_most(9, f"messages lost {beside}", [(f"{load.RATE} Hz", lost)], 0, ""),
        at_most(9, f"insert {beside}, 99th percentile", [("one buffer", _ratio(insert, 1e6))], 1, " ms"),
        # No more, but for what else the machine does.
        at_most(
            9, f"sleep {beside}: how late, over another buffer", [("1 ms, 99th", ratio_by_rounds(*late))], 1.1
        ),
        at_most(9, "lookup beside messages, 99.9th percentile above another buffer's", held_up, 0.2, " ms"),
    ]


def _waiters(rows: Rows) -> list[Verdict]:
    beside = [
        (f"{kind}, into {into}", waiters.ratio(rows, kind, into))
        for kind in waiters.KINDS
        for into in waiters.INTO
    ]
    fails = [
        (f"{way}, {why}", failing.ratio(rows, way, why)) for way in failing.WAYS for why in failing.REASONS
    ]
    return [
        at_most(10, "insert that answers no waiter over one beside none", beside, 1.2),
        at_most(10, "lookup that fails, in a large tree over in a small one", fails, 1.2),
    ]
