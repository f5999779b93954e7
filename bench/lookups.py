"""Owns measuring single lookups: static and dynamic trees, by hops; deep histories, by place."""

from __future__ import annotations

import numpy as np

from bench.arena import Arena
from bench.trees import LATEST, Tree, bushy, chain, write_queries

SECTION = "lookups"
HOPS = (1, 4, 10)
DEEP_HOPS = 4
PLACES = ("newest", "random", "oldest")


def run(arena: Arena) -> None:
    sizes = arena.sizes
    samples = round(sizes.seconds * 100)
    trees = [bushy(f"static {sizes.static_frames}", sizes.static_frames, 0.0, 0)]
    trees += [bushy(f"dynamic {frames}", frames, 0.5, samples) for frames in sizes.dynamic_frames]
    for tree in trees:
        _run_tree(arena, tree)
    for depth in sizes.depths:
        _run_depth(arena, depth)


def _run_tree(arena: Arena, tree: Tree) -> None:
    sizes = arena.sizes
    moving = any(tree.dynamic)
    keys = arena.load(tree, arena.with_lookups())
    for place in ("past", "latest") if moving else ("static",):
        for hops in HOPS:
            arena.say(f"lookups: {tree.name} frames, {place}, {hops} hops")
            pairs = tree.pairs(hops, sizes.queries, seed=hops, must_move=moving)
            times = (
                tree.random_times(sizes.queries, hops) if place == "past" else np.full(sizes.queries, LATEST)
            )
            labels = {"tree": tree.name, "place": place, "hops": hops}
            queries = write_queries(arena.folder / "lookups.queries", pairs, times)
            arena.race(SECTION, arena.aim(SECTION, labels, arena.ways(keys), queries, sizes.calls))


def _run_depth(arena: Arena, depth: int) -> None:
    sizes = arena.sizes
    tree = chain(f"chain of {depth}", DEEP_HOPS, depth)
    keys = arena.load(tree, arena.with_lookups())
    for place in PLACES:
        arena.say(f"lookups: {depth} samples per frame, {place}")
        times = {
            "newest": np.full(sizes.queries, tree.newest_ns),
            "random": tree.random_times(sizes.queries, depth),
            "oldest": np.full(sizes.queries, tree.first_ns),
        }[place]
        labels = {"tree": tree.name, "place": place, "hops": DEEP_HOPS, "depth": depth}
        queries = write_queries(arena.folder / "lookups.queries", [(0, DEEP_HOPS)], times)
        arena.race(SECTION, arena.aim(SECTION, labels, arena.ways(keys), queries, sizes.calls))
