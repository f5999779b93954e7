"""Owns measuring inserts beside waiters that they do not answer."""

from __future__ import annotations

import statistics
from dataclasses import replace

from bench.arena import OURS, Arena
from bench.processes import CONTESTANTS, Failure, Process
from bench.rows import Rows, ratio_by_rounds, row_of

SECTION = "waiters"
TITLE = "Inserts beside waiters that they do not answer: times what they take beside none"
KINDS = (
    "later",
    "earlier",
    "unknown target",
    "unknown source",
    "latest, unconnected",
    "latest, new parent",
    "two times",
    "a time, unconnected",
    "later, in a loop",
)
INTO = ("own frame", "other frame", "two parents", "alternating", "new frame", "static or not")
FIRST, COLUMN = 24, 14


def run(arena: Arena) -> None:
    sizes = arena.sizes
    library = arena.libraries[OURS]
    program = [library.command[0], str(CONTESTANTS / "waiting.py")]
    process = Process(replace(library, command=program))
    values: dict[tuple[str, str, int], list[list[float]]] = {}
    try:
        for turn in range(sizes.rounds):
            arena.say(f"waiters: {sizes.waiters} of each kind, round {turn + 1}")
            for kind in KINDS:
                _measure(arena, process, kind, values)
    except Failure as failure:
        arena.absent.append({"who": OURS, "what": SECTION, "reason": str(failure)})
        return
    finally:
        process.end()
    for (kind, into, count), rounds in values.items():
        arena.rows.append(row_of(SECTION, OURS, into, {"waiting_for": kind, "waiters": count}, rounds))


def _measure(
    arena: Arena, process: Process, kind: str, values: dict[tuple[str, str, int], list[list[float]]]
) -> None:
    sizes = arena.sizes
    pending = process.ask("prepare", kind, sizes.waiters)["pending"]
    if pending != sizes.waiters:
        raise Failure(f"only {pending} of {sizes.waiters} wait: {kind}")
    for into in INTO:
        answer = process.ask("insert", kind, into, sizes.waited_inserts, sizes.budget_s / 10)
        if answer["pending"] != sizes.waiters:
            raise Failure(f"an insert into {into} answered some that wait: {kind}")
        for count, key in (0, "alone"), (sizes.waiters, "beside"):
            ns = [ns - answer["empty_ns"] for ns in answer[key]]
            values.setdefault((kind, into, count), []).append(ns)


def table(rows: Rows) -> str:
    """How many times as long each insert takes beside the waiters, and its median beside none, us."""
    lines = [" " * FIRST + "".join(f"{into:>{COLUMN}}" for into in INTO)]
    alone = [
        [row.median / 1e3 for row in rows if row.way == into and not row.labels["waiters"]] for into in INTO
    ]
    lines.append(f"{'beside none, us':{FIRST}}" + "".join(_cell(statistics.median(us), "") for us in alone))
    for kind in KINDS:
        cells = [_cell(ratio(rows, kind, into), "x") for into in INTO]
        lines.append(f"{kind:{FIRST}}" + "".join(cells))
    return "\n".join(lines)


def ratio(rows: Rows, kind: str, into: str) -> float | None:
    """Beside many waiters of a kind to beside none; None where it was not measured."""
    found = [
        row for row in rows if (row.section, row.way) == (SECTION, into) and row.labels["waiting_for"] == kind
    ]
    alone, beside = sorted(found, key=lambda row: row.labels["waiters"]) or (None, None)
    return ratio_by_rounds(beside, alone)


def _cell(value: float | None, unit: str) -> str:
    if value is None:
        return f"{'-':>{COLUMN}}"
    text = f"{value:.2f}" if value < 100 else f"{value:,.0f}"
    return f"{text + unit:>{COLUMN}}"
