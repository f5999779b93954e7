"""Owns measuring inserts into full histories: by message, batch, serialised message, with many waiting."""

from __future__ import annotations

from typing import Any

from bench.arena import OURS, Arena, Entry
from bench.processes import Failure
from bench.rows import row_of
from bench.trees import Tree, bushy

SECTION = "inserts"
FRAMES = 50
CACHE_S = 10.0
OUR_WAYS = ("set_transform", "set_transforms", "set_transforms_cdr", "set_transforms_cdr of 1")
CANNOT_INSERT = ("pytransform3d",)
# Nobody known to the buffer, and known frames later than anything that comes.
WAITING_FOR = ("unknown", "later")


def run(arena: Arena) -> None:
    arena.say("inserts: filling histories")
    # Longer than the cache, so that every insert drops an old sample, as in a program that runs for long.
    samples = round(CACHE_S * 100) + 100
    tree = bushy(f"inserts {FRAMES}", FRAMES + 1, 1.0, samples)
    tree.cache_s = CACHE_S
    keys = arena.load(tree, [who for who in arena.with_lookups() if who not in CANNOT_INSERT])
    entries = [
        Entry(who, way, {"frames": FRAMES}, ("insert", way, arena.sizes.inserts))
        for who in keys
        for way in (OUR_WAYS if who == OURS else ("set_transform",))
    ]
    arena.say("inserts: rounds")
    arena.race(SECTION, entries)
    if OURS in keys:
        _run_waiting(arena, tree)


def _run_waiting(arena: Arena, tree: Tree) -> None:
    """set_transform with many waiting, in turn with none waiting."""
    sizes = arena.sizes
    alone: list[list[float]] = []
    beside: dict[str, list[list[float]]] = {what: [] for what in WAITING_FOR}
    try:
        for turn in range(sizes.rounds):
            arena.say(f"inserts: {sizes.waiters} waiters, round {turn + 1}")
            alone.append(_insert(arena))
            for what in WAITING_FOR:
                pending = arena.ask(OURS, "wait", what, sizes.waiters)["pending"]
                if pending != sizes.waiters:
                    raise Failure(f"only {pending} of {sizes.waiters} wait")
                beside[what].append(_insert(arena))
                arena.ask(OURS, "stop_waiting")
    except Failure as failure:
        arena.absent.append({"who": OURS, "what": f"{sizes.waiters} waiters", "reason": str(failure)})
        return
    labels: dict[str, Any] = {"frames": FRAMES, "waiters": 0}
    arena.rows.append(row_of(SECTION, OURS, "set_transform beside waiters", labels, alone))
    for what in WAITING_FOR:
        labels = {"frames": FRAMES, "waiters": sizes.waiters, "waiting_for": what}
        arena.rows.append(row_of(SECTION, OURS, "set_transform beside waiters", labels, beside[what]))


def _insert(arena: Arena) -> list[float]:
    answer = arena.ask(OURS, "insert", "set_transform", arena.sizes.inserts, arena.sizes.budget_s)
    return [ns - answer["empty_ns"] for ns in answer["ns"]]
