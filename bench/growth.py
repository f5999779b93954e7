"""Owns measuring how cost grows: with the length of history, the number of frames, the depth of the tree."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.arena import OURS, Arena, Entry
from bench.trees import Tree, bushy, chain, fork, write_queries, write_vector_queries

SECTION = "growth"
HOPS = 4
SAMPLES = 10  # per frame, where the history is not what grows
FEW = 6  # pairs that are asked again and again
AXES = ("samples", "frames", "ancestors")
# In a short run fewer take part, for each must take in the largest trees.
QUICK_PEERS = (OURS, "ros1_cpp")


def run(arena: Arena) -> None:
    sizes = arena.sizes
    _run_axis(
        arena, "samples", [chain(f"samples {n}", HOPS, n) for n in sizes.growth_samples], sizes.growth_samples
    )
    _run_axis(
        arena,
        "frames",
        [bushy(f"frames {n}", n, 1.0, SAMPLES) for n in sizes.growth_frames],
        sizes.growth_frames,
    )
    _run_axis(
        arena,
        "ancestors",
        [fork(f"ancestors {n}", n, SAMPLES) for n in sizes.growth_ancestors],
        sizes.growth_ancestors,
    )


def _run_axis(arena: Arena, axis: str, trees: Sequence[Tree], values: Sequence[int]) -> None:
    # Every size is in memory before the first round, so that all sizes share good and bad moments.
    entries: list[Entry] = []
    for index, (tree, value) in enumerate(zip(trees, values, strict=True)):
        arena.say(f"growth: taking in {tree.name}")
        wanted = arena.with_lookups() if arena.sizes.thorough else QUICK_PEERS
        wanted = [who for who in wanted if who != "pytransform3d"]  # a thousand times slower than the others
        keys = arena.load(tree, wanted, keep=index > 0)
        for pairs_kind, pairs in _pairs(arena, axis, tree).items():
            entries += _aim(arena, axis, tree, value, pairs_kind, pairs, keys)
    arena.say(f"growth: rounds over {axis}")
    arena.race(SECTION, entries)


def _pairs(arena: Arena, axis: str, tree: Tree) -> dict[str, list[tuple[int, int]]]:
    if axis == "samples":
        return {"few": [(0, HOPS)]}
    if axis == "ancestors":
        return {"few": [(len(tree.parents) - 2, len(tree.parents) - 1)]}
    # A program asks for the same few pairs; asking for all of them measures the machine's caches, too.
    return {
        "few": tree.pairs(HOPS, FEW, seed=1, must_move=True),
        "many": tree.pairs(HOPS, arena.sizes.queries, seed=2, must_move=True),
    }


def _aim(
    arena: Arena,
    axis: str,
    tree: Tree,
    value: int,
    pairs_kind: str,
    pairs: list[tuple[int, int]],
    keys: Sequence[str],
) -> list[Entry]:
    sizes = arena.sizes
    labels = {"axis": axis, "value": value, "pairs": pairs_kind}
    times = tree.random_times(sizes.queries, value)
    queries = write_queries(arena.folder / "growth.queries", pairs, times)
    # Of ours, what users call; of the others, what they have.
    contenders = [(who, way) for who, way in arena.ways(keys) if (who, way) != (OURS, "core")]
    entries = arena.aim(SECTION, labels, contenders, queries, sizes.calls)
    if OURS in keys and pairs_kind == "few":
        sorted_times = [np.sort(tree.random_times(sizes.vector_times, value + i)) for i in range(len(pairs))]
        queries = write_vector_queries(arena.folder / "growth.queries", pairs, sorted_times)
        entries += arena.aim(SECTION, labels, [(OURS, "vector")], queries, len(pairs), sizes.vector_times)
    return entries
