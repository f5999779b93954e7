"""Owns measuring lookups at many times in one call: each cell, beside NumPy and SciPy, in two threads."""

from __future__ import annotations

import numpy as np

from bench.arena import OURS, Arena
from bench.lookups import DEEP_HOPS, HOPS
from bench.rows import row_of
from bench.trees import LATEST, Tree, bushy, chain, write_vector_queries

SECTION = "vectors"
THREADS = 2
# Both are given one chain: SciPy has no tree, pytransform3d takes long to take one in.
PEERS = ("pytransform3d", "scipy")


def run(arena: Arena) -> None:
    sizes = arena.sizes
    samples = round(sizes.seconds * 100)
    _run_tree(arena, bushy(f"static {sizes.static_frames}", sizes.static_frames, 0.0, 0))
    _run_tree(arena, bushy(f"dynamic {sizes.dynamic_frames[0]}", sizes.dynamic_frames[0], 0.5, samples))
    for depth in sizes.depths[1:]:
        _run_chain(arena, depth)


def _run_tree(arena: Arena, tree: Tree) -> None:
    sizes = arena.sizes
    moving = any(tree.dynamic)
    keys = arena.load(tree, [OURS])
    entries = []
    for place in ("sorted", "random", "latest") if moving else ("static",):
        for hops in HOPS:
            arena.say(f"vectors: {tree.name} frames, {place}, {hops} hops")
            pairs = tree.pairs(hops, sizes.vector_pairs, seed=hops, must_move=moving)
            times = [_times(tree, place, sizes.vector_times, seed) for seed in range(len(pairs))]
            labels = {"tree": tree.name, "place": place, "hops": hops}
            queries = write_vector_queries(arena.folder / "vectors.queries", pairs, times)
            entries += arena.aim(
                SECTION,
                labels,
                [(who, "vector") for who in keys],
                queries,
                sizes.vector_pairs,
                sizes.vector_times,
            )
    arena.race(SECTION, entries)


def _run_chain(arena: Arena, depth: int) -> None:
    sizes = arena.sizes
    tree = chain(f"chain of {depth}", DEEP_HOPS, depth)
    keys = arena.load(tree, [OURS, *(PEERS if depth == sizes.depths[1] else ())])
    for place in ("sorted", "random"):
        arena.say(f"vectors: {depth} samples per frame, {place}")
        times = _times(tree, place, sizes.vector_times, depth)
        labels = {"tree": tree.name, "place": place, "hops": DEEP_HOPS}
        queries = write_vector_queries(arena.folder / "vectors.queries", [(0, DEEP_HOPS)], [times])
        entries = arena.aim(
            SECTION,
            labels,
            [(who, "vector") for who in keys],
            queries,
            sizes.vector_pairs,
            sizes.vector_times,
        )
        arena.race(SECTION, entries)
    if OURS in keys:
        _run_points(arena, tree)
        _run_threads(arena, tree)


def _run_points(arena: Arena, tree: Tree) -> None:
    times = _times(tree, "sorted", arena.sizes.points, 5)
    labels = {"tree": tree.name, "place": "sorted", "hops": DEEP_HOPS}
    queries = write_vector_queries(arena.folder / "vectors.queries", [(0, DEEP_HOPS)], [times])
    entries = arena.aim(SECTION, labels, [(OURS, "points")], queries, 2, arena.sizes.points)
    arena.race(SECTION, entries)


def _run_threads(arena: Arena, tree: Tree) -> None:
    """How much more two threads do than one, in the same buffer."""
    sizes = arena.sizes
    arena.say(f"vectors: {THREADS} threads beside one")
    times = _times(tree, "sorted", sizes.vector_times, 6)
    queries = write_vector_queries(arena.folder / "vectors.queries", [(0, DEEP_HOPS)], [times])
    if arena.attempt(OURS, "threads", "aim", "vector", "threads", queries, 0) is None:
        return
    calls = 10 * sizes.vector_pairs
    gains = []
    for _ in range(sizes.rounds):
        # Once before and once after, for the machine's speed drifts.
        counts = 1, THREADS, 1
        answers = [arena.attempt(OURS, "threads", "threads", "threads", count, calls) for count in counts]
        before, together, after = (answer["ns"] if answer else None for answer in answers)
        if before and together and after:
            gains.append([THREADS * (before + after) / 2 / together])
    if not gains:
        return
    arena.rows.append(
        row_of(SECTION, OURS, "threads", {"tree": tree.name, "threads": THREADS}, gains, unit="x")
    )


def _times(tree: Tree, place: str, count: int, seed: int) -> np.ndarray:
    if place in ("latest", "static"):
        return np.full(count, LATEST)
    times = tree.random_times(count, seed)
    return np.sort(times) if place == "sorted" else times
