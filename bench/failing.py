"""Owns measuring lookups that fail, in small and in large trees."""

from __future__ import annotations

from dataclasses import replace

from bench.arena import OURS, Arena
from bench.processes import CONTESTANTS, Failure, Process
from bench.rows import Rows, ratio_by_rounds, row_of

SECTION = "failing"
WAYS = ("lookup_transform_core", "can_transform_core")
REASONS = ("extrapolation", "unknown frame", "two trees")


def run(arena: Arena) -> None:
    sizes = arena.sizes
    arena.say(f"failing: trees of {' and '.join(f'{frames:,}' for frames in sizes.failing_frames)} frames")
    library = arena.libraries[OURS]
    process = Process(replace(library, command=[library.command[0], str(CONTESTANTS / "failing.py")]))
    cells = [(way, why, frames) for way in WAYS for why in REASONS for frames in sizes.failing_frames]
    values: dict[tuple[str, str, int], list[list[float]]] = {cell: [] for cell in cells}
    try:
        for frames in sizes.failing_frames:
            process.ask("load", frames)
        for _ in range(sizes.rounds):
            for (way, why, frames), rounds in values.items():
                answer = process.ask("fail", frames, way, why, sizes.calls, sizes.budget_s / 2)
                rounds.append([ns - answer["empty_ns"] for ns in answer["ns"]])
    except Failure as failure:
        arena.absent.append({"who": OURS, "what": SECTION, "reason": str(failure)})
        return
    finally:
        process.end()
    for (way, why, frames), rounds in values.items():
        arena.rows.append(row_of(SECTION, OURS, way, {"frames": frames, "reason": why}, rounds))


def ratio(rows: Rows, way: str, why: str) -> float | None:
    """In the largest tree to in the smallest; None where it was not measured."""
    found = [row for row in rows if (row.section, row.way) == (SECTION, way) and row.labels["reason"] == why]
    found.sort(key=lambda row: row.labels["frames"])
    return ratio_by_rounds(found[-1], found[0]) if found else None
