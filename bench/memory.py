"""Owns measuring memory per dynamic sample: what our buffer accounts for, and what each process holds."""

from __future__ import annotations

from bench.arena import OURS, Arena
from bench.processes import Failure
from bench.rows import row_of
from bench.trees import chain

SECTION = "memory"
SAMPLES = 10_000  # of one frame: 100 s, for schiebung keeps 120 s


def run(arena: Arena) -> None:
    sizes = arena.sizes
    arena.say("memory: one ring, sample by sample")
    arena.restart(OURS)
    try:
        ring = arena.ask(OURS, "ring", sizes.ring_samples)
        arena.restart(OURS)
        resident = arena.ask(OURS, "resident", sizes.resident_samples)
    except Failure as failure:
        arena.absent.append({"who": OURS, "what": SECTION, "reason": str(failure)})
    else:
        _add(arena, OURS, "ring, fullest", {"samples": ring["best_at"]}, ring["best"])
        _add(arena, OURS, "ring, just grown", {"samples": ring["worst_at"]}, ring["worst"])
        _add(arena, OURS, "resident, while growing", {"samples": sizes.resident_samples}, resident["worst"])
    tree = chain("memory", max(1, sizes.resident_samples // SAMPLES), SAMPLES)
    path = tree.write(arena.folder)
    for who in arena.with_lookups():
        arena.say(f"memory: {arena.libraries[who].label}")
        arena.restart(who)
        answer = arena.attempt(who, SECTION, "load", path, 0)
        if answer is not None:
            samples = sum(tree.dynamic) * tree.samples
            _add(arena, who, "resident", {"samples": samples}, answer["rss_bytes"] / samples)


def _add(arena: Arena, who: str, way: str, labels: dict[str, int], value: float) -> None:
    arena.rows.append(row_of(SECTION, who, way, labels, [[value]], unit="B"))
