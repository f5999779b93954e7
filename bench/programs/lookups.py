# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure lookups: at one time, and at many times."""

from trees_and_queries import bushy, chain

HOPS = (1, 4, 10)
DEEP_HOPS = 4
EVALUATED_S = 2.0  # enough for all 5,000 lookups that warm up
MOVING_SAMPLES = 1000  # per frame
TURNING = "chain with random rotations"  # slerp takes its branch for samples that are far apart
MOVING, MOUNTED = 2, 6  # odometry and localisation; the frames from the base to a camera's optics


def lookups(rows, sizes, library):
    """One lookup: in trees of static and moving frames, and along chains, whose histories grow, by place."""
    for tree, hops, pairs in _cases(sizes, library, sizes.queries):
        for place in ("newest", "random", "oldest") if "chain" in tree.name else _places(tree, "past latest"):
            labels = {"tree": tree.name, "place": place, "hops": hops}
            queries = tree.queries(pairs, tree.times(place, sizes.queries))
            for way in library.ways:
                rows.time_lookups(library, way, labels, queries, sizes)


def as_evaluated(rows, sizes, library):
    """
    The two kinds offline of the evaluation of tf2_rs: a tree of static frames, and one half of whose frames
    move, at random times.
    """
    frames = sizes.evaluated_frames
    static = bushy(f"static {frames}", frames, 0.0, 0)
    for tree in static, bushy(f"dynamic {frames}", frames, 0.5, round(sizes.seconds * 100)):
        library.load(tree)
        place = _places(tree, "past")[0]
        for hops in HOPS:
            labels = {"tree": tree.name, "place": place, "hops": hops}
            queries = tree.queries(tree.pairs(hops, sizes.queries), tree.times(place, sizes.queries))
            for way in library.ways:
                if "matrix" not in way:
                    rows.time_lookups(library, way, labels, queries, sizes, budget_s=EVALUATED_S)


def vectors(rows, sizes, library):
    """Many times in one call."""
    for tree, hops, pairs in _cases(sizes, library, sizes.vector_pairs):
        for place in _places(tree, "sorted random"):
            labels = {"tree": tree.name, "place": place, "hops": hops}
            queries = tree.vector_queries(pairs, place, sizes.vector_times)
            for way in library.vector_ways:
                rows.time_lookups(library, way, labels, queries, sizes, per=sizes.vector_times)


def _places(tree, of_moving):
    return of_moving.split() if any(tree.dynamic) else ["static"]


def _cases(sizes, library, count):
    """Each tree, loaded, with pairs of frames so many hops apart; in bushy ones, `count` random pairs."""
    trees = [bushy(f"static {sizes.static_frames}", sizes.static_frames, 0.0, 0)]
    for frames in sizes.dynamic_frames:
        trees.append(bushy(f"dynamic {frames}", frames, 0.5, round(sizes.seconds * 100)))
    for tree in trees:
        library.load(tree)
        for hops in HOPS:
            yield tree, hops, tree.pairs(hops, count)
    chains = [
        ("moving chain", HOPS, MOVING_SAMPLES, None),
        (TURNING, HOPS, MOVING_SAMPLES, None),
        (f"robot with {MOVING} moving frames", (MOVING + MOUNTED,), MOVING_SAMPLES, MOVING),
        *((f"chain of {depth:,} samples", (DEEP_HOPS,), depth, None) for depth in sizes.depths),
    ]
    for name, several_hops, depth, moving in chains:
        tree = chain(name, several_hops[-1], depth, moving, turns_at_random=name == TURNING)
        library.load(tree)
        for hops in several_hops:
            yield tree, hops, [(0, hops)]
