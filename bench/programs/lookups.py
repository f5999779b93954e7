"""Measure lookups: at one time, at many times, and how their cost grows with the tree."""

import threading
from time import perf_counter_ns

from trees_and_queries import bushy, chain, fork

HOPS = (1, 4, 10)
DEEP_HOPS = 4
MOVING_SAMPLES = 1000  # per frame
THREADS = 2
GROWTH_SAMPLES = 10  # per frame, where the history is not what grows
FEW = 6  # pairs that are looked up again and again


def _trees(sizes):
    yield bushy(f"static {sizes.static_frames}", sizes.static_frames, 0.0, 0)
    for frames in sizes.dynamic_frames:
        yield bushy(f"dynamic {frames}", frames, 0.5, round(sizes.seconds * 100))


def _deep_trees(sizes):
    return [chain(f"chain of {depth} samples", DEEP_HOPS, depth) for depth in sizes.depths]


def _moving_tree():
    return chain("moving chain", HOPS[-1], MOVING_SAMPLES)


def lookups(rows, sizes, library):
    """One lookup: in static and dynamic trees and along moving frames by hops, in deep histories by place."""
    for tree in _trees(sizes):
        library.load(tree)
        for place in ("past", "latest") if any(tree.dynamic) else ("static",):
            for hops in HOPS:
                labels = {"tree": tree.name, "place": place, "hops": hops}
                pairs = tree.pairs(hops, sizes.queries)
                _time(rows, sizes, library, tree, pairs, place, labels)
    tree = _moving_tree()
    library.load(tree)
    for hops in HOPS:
        labels = {"tree": tree.name, "place": "random", "hops": hops}
        _time(rows, sizes, library, tree, [(0, hops)], "random", labels)
    for tree in _deep_trees(sizes):
        library.load(tree)
        for place in ("newest", "random", "oldest"):
            labels = {"tree": tree.name, "place": place, "hops": DEEP_HOPS}
            _time(rows, sizes, library, tree, [(0, DEEP_HOPS)], place, labels)


def _time(rows, sizes, library, tree, pairs, place, labels):
    queries = tree.queries(pairs, tree.times(place, sizes.queries))
    for way in library.ways:
        rows.time_lookups(library, way, labels, queries, sizes)


def vectors(rows, sizes, library):
    """Many times in one call: each cell, and in two threads."""
    for tree in _trees(sizes):
        library.load(tree)
        for place in ("sorted", "random") if any(tree.dynamic) else ("static",):
            for hops in HOPS:
                labels = {"tree": tree.name, "place": place, "hops": hops}
                _time_vector(rows, sizes, library, tree, tree.pairs(hops, sizes.vector_pairs), place, labels)
    tree = _moving_tree()
    library.load(tree)
    for place in ("sorted", "random"):
        for hops in HOPS:
            labels = {"tree": tree.name, "place": place, "hops": hops}
            _time_vector(rows, sizes, library, tree, [(0, hops)], place, labels)
    for tree in _deep_trees(sizes)[1:]:
        library.load(tree)
        for place in ("sorted", "random"):
            labels = {"tree": tree.name, "place": place, "hops": DEEP_HOPS}
            _time_vector(rows, sizes, library, tree, [(0, DEEP_HOPS)], place, labels)
        _time_threads(rows, sizes, library, tree)


def _time_vector(rows, sizes, library, tree, pairs, place, labels):
    queries = tree.vector_queries(pairs, place, sizes.vector_times)
    for way in library.vector_ways:
        rows.time_lookups(library, way, labels, queries, sizes, per=sizes.vector_times)


def _time_threads(rows, sizes, library, tree):
    """How much more two threads do than one: 2 at best."""
    function, (arguments,) = library.calls(
        "vector", tree.vector_queries([(0, DEEP_HOPS)], "sorted", sizes.vector_times)
    )

    def seconds(threads):
        began, ends = [], []
        begin = threading.Barrier(threads, lambda: began.append(perf_counter_ns()))

        def work():
            begin.wait()
            for _ in range(10 * sizes.vector_pairs):
                function(*arguments)
            ends.append(perf_counter_ns())

        workers = [threading.Thread(target=work) for _ in range(threads)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        return max(ends) - began[0]

    # One thread before and after, because the machine's speed drifts.
    before, together, after = seconds(1), seconds(THREADS), seconds(1)
    gain = THREADS * (before + after) / 2 / together
    rows.add(f"{THREADS} threads", {"tree": tree.name, "place": "sorted", "hops": DEEP_HOPS}, [gain], "x")


def growth(rows, sizes, library):
    """How cost grows with the length of history, the number of frames, the depth of the tree."""
    for axis, tree, kinds in _growing(sizes):
        library.load(tree)
        for kind, pairs in kinds.items():
            labels = {**axis, "pairs": kind}
            queries = tree.queries(pairs, tree.times("random", sizes.queries))
            rows.time_lookups(library, library.ways[0], labels, queries, sizes)
            if library.vector_ways:
                _time_vector(rows, sizes, library, tree, pairs[:FEW], "sorted", labels)


def _growing(sizes):
    """What grows and how far, the tree, and by their names the pairs that are looked up."""
    for samples in sizes.growth_samples:
        yield {"samples": samples}, chain("samples", DEEP_HOPS, samples), {"few pairs": [(0, DEEP_HOPS)]}
    for frames in sizes.growth_frames:
        tree = bushy("frames", frames, 1.0, GROWTH_SAMPLES)
        few, many = tree.pairs(DEEP_HOPS, FEW), tree.pairs(DEEP_HOPS, sizes.queries)
        # A program looks up the same few pairs; looking up all of them measures the machine's caches, too.
        yield {"frames": frames}, tree, {"few pairs": few, "all pairs": many}
    for ancestors in sizes.growth_ancestors:
        tree = fork("ancestors", ancestors, GROWTH_SAMPLES)
        frames = len(tree.parents)
        yield {"ancestors": ancestors}, tree, {"few pairs": [(frames - 2, frames - 1)]}
