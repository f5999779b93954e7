"""Measure lookups: one time, many times, growth with the tree, lookups that fail."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from bench.race import OURS, Entry, Run, Sample, set_name
from bench.trees import LATEST, Tree, bushy, chain, fork, queries_of, vector_queries_of

HOPS = (1, 4, 10)
DEEP_HOPS = 4
THREADS = 2

GROWTH_SAMPLES = 10  # per frame, where the history is not what grows
FEW = 6  # pairs that are looked up again and again
# In a short run fewer take part, for each must load the largest trees.
QUICK_GROWTH_PEERS = (OURS, "ros1_cpp")


def lookups(run: Run) -> None:
    """One lookup: in static and dynamic trees by hops, in deep histories by place."""
    for tree in _trees(run, run.sizes.dynamic_frames):
        keys = run.load(tree, run.libraries)
        for place in ("past", "latest") if tree.moves else ("static",):
            for hops in HOPS:
                labels = {"tree": tree.name, "place": place, "hops": hops}
                pairs = tree.pairs(hops, run.sizes.queries, seed=hops, must_move=tree.moves)
                _race_lookups(run, keys, tree, labels, pairs, hops)
    for depth in run.sizes.depths:
        tree = chain(f"chain of {depth}", DEEP_HOPS, depth)
        keys = run.load(tree, run.libraries)
        for place in ("newest", "random", "oldest"):
            labels = {"tree": tree.name, "place": place, "hops": DEEP_HOPS, "depth": depth}
            _race_lookups(run, keys, tree, labels, [(0, DEEP_HOPS)], depth)


def _trees(run: Run, dynamic_frames: Iterable[int]) -> list[Tree]:
    sizes = run.sizes
    still = bushy(f"static {sizes.static_frames}", sizes.static_frames, 0.0, 0)
    samples = round(sizes.seconds * 100)
    return [still, *(bushy(f"dynamic {frames}", frames, 0.5, samples) for frames in dynamic_frames)]


def _race_lookups(
    run: Run, keys: list[str], tree: Tree, labels: dict, pairs: Sequence[tuple[int, int]], seed: int
) -> None:
    run.say(f"lookups: {', '.join(map(str, labels.values()))} hops")
    times = _times(tree, labels["place"], run.sizes.queries, seed)
    queries = queries_of(pairs, times)
    run.race("lookups", run.prepare("lookups", labels, run.ways(keys), queries, run.sizes.calls))


def _times(tree: Tree, place: str, count: int, seed: int) -> np.ndarray:
    fixed = {"static": LATEST, "latest": LATEST, "newest": tree.newest_ns, "oldest": tree.first_ns}
    if place in fixed:
        return np.full(count, fixed[place])
    times = tree.random_times(count, seed)
    return np.sort(times) if place == "sorted" else times


def vectors(run: Run) -> None:
    """Many times in one call: each cell, and in two threads."""
    sizes = run.sizes
    for tree in _trees(run, sizes.dynamic_frames[:1]):
        run.say(f"vectors: {tree.name} frames")
        keys = run.load(tree, [OURS])
        entries = []
        for place in ("sorted", "random", "latest") if tree.moves else ("static",):
            for hops in HOPS:
                pairs = tree.pairs(hops, sizes.vector_pairs, seed=hops, must_move=tree.moves)
                entries += _vector_entries(run, keys, tree, place, hops, pairs)
        run.race("vectors", entries)
    for depth in sizes.depths[1:]:
        tree = chain(f"chain of {depth}", DEEP_HOPS, depth)
        run.say(f"vectors: {tree.name} samples per frame, and in {THREADS} threads")
        keys = run.load(tree, [OURS])
        for place in ("sorted", "random"):
            run.race("vectors", _vector_entries(run, keys, tree, place, DEEP_HOPS, [(0, DEEP_HOPS)]))
        if OURS in keys:
            _race_points_and_threads(run, tree)


def _vector_entries(
    run: Run, keys: list[str], tree: Tree, place: str, hops: int, pairs: Sequence[tuple[int, int]]
) -> list[Entry]:
    sizes = run.sizes
    times = [_times(tree, place, sizes.vector_times, seed) for seed in range(len(pairs))]
    queries = vector_queries_of(pairs, times)
    labels = {"tree": tree.name, "place": place, "hops": hops}
    contenders = [(who, "vector") for who in keys]
    return run.prepare("vectors", labels, contenders, queries, sizes.vector_pairs, sizes.vector_times)


def _race_points_and_threads(run: Run, tree: Tree) -> None:
    sizes = run.sizes
    labels = {"tree": tree.name, "place": "sorted", "hops": DEEP_HOPS}
    times = _times(tree, "sorted", sizes.points, 5)
    queries = vector_queries_of([(0, DEEP_HOPS)], [times])
    run.race("vectors", run.prepare("vectors", labels, [(OURS, "points")], queries, 2, sizes.points))

    def gain() -> list[Sample]:
        # One thread before and after, because the machine's speed drifts.
        order = "threads", "vector", set_name("vectors", labels)
        before, together, after = (run.ask(OURS, *order, n, calls)["ns"] for n in (1, THREADS, 1))
        ratio = THREADS * (before + after) / 2 / together
        return [Sample(OURS, "threads", {"tree": tree.name, "threads": THREADS}, [ratio], "x")]

    calls = 10 * sizes.vector_pairs
    run.race("vectors", [Entry(OURS, gain)])


def growth(run: Run) -> None:
    """How cost grows with the length of history, the number of frames, the depth of the tree."""
    sizes = run.sizes
    trees = {
        "samples": [(n, chain(f"samples {n}", DEEP_HOPS, n)) for n in sizes.growth_samples],
        "frames": [(n, bushy(f"frames {n}", n, 1.0, GROWTH_SAMPLES)) for n in sizes.growth_frames],
        "ancestors": [(n, fork(f"ancestors {n}", n, GROWTH_SAMPLES)) for n in sizes.growth_ancestors],
    }
    wanted = list(run.libraries) if sizes.thorough else QUICK_GROWTH_PEERS
    for axis, grown in trees.items():
        # Every size is in memory before the first round, so that a disturbance affects all sizes.
        entries: list[Entry] = []
        for index, (value, tree) in enumerate(grown):
            run.say(f"growth: loading {tree.name}")
            keys = run.load(tree, wanted, keep=index > 0)
            for kind, pairs in _growth_pairs(run, axis, tree).items():
                labels = {"axis": axis, "value": value, "pairs": kind}
                entries += _growth_entries(run, keys, tree, labels, pairs)
        run.say(f"growth: rounds over {axis}")
        run.race("growth", entries)


def _growth_pairs(run: Run, axis: str, tree: Tree) -> dict[str, list[tuple[int, int]]]:
    if axis == "samples":
        return {"few": [(0, DEEP_HOPS)]}
    if axis == "ancestors":
        return {"few": [(len(tree.parents) - 2, len(tree.parents) - 1)]}
    # A program looks up the same few pairs; looking up all of them measures the machine's caches, too.
    return {
        "few": tree.pairs(DEEP_HOPS, FEW, seed=1, must_move=True),
        "many": tree.pairs(DEEP_HOPS, run.sizes.queries, seed=2, must_move=True),
    }


def _growth_entries(
    run: Run, keys: list[str], tree: Tree, labels: dict, pairs: list[tuple[int, int]]
) -> list[Entry]:
    sizes, value = run.sizes, labels["value"]
    queries = queries_of(pairs, tree.random_times(sizes.queries, value))
    # Of ours, what users call; of the others, what they have.
    contenders = [(who, way) for who, way in run.ways(keys) if (who, way) != (OURS, "core")]
    entries = run.prepare("growth", labels, contenders, queries, sizes.calls)
    if OURS in keys and labels["pairs"] == "few":
        times = [_times(tree, "sorted", sizes.vector_times, value + i) for i in range(len(pairs))]
        queries = vector_queries_of(pairs, times)
        entries += run.prepare("growth", labels, [(OURS, "vector")], queries, len(pairs), sizes.vector_times)
    return entries
