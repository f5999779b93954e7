# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure frozen files: writing one, opening it, and looking up in it."""

from pathlib import Path
from time import perf_counter_ns

from trees_and_queries import bushy

from tf2_ros import Buffer

HOPS = 4


def frozen(rows, sizes, library):
    """A tree of 50 moving frames."""
    samples = sizes.frozen_samples // sizes.frozen_frames
    tree = bushy("frozen", sizes.frozen_frames + 1, 1.0, samples, cache_s=samples)
    labels, path = {"samples": len(tree.records)}, Path(sizes.folder, "frozen")
    queries = tree.queries(tree.pairs(HOPS, 20), tree.times("random", sizes.queries))
    library.load(tree)
    start = perf_counter_ns()
    library.buffer.freeze(path)
    rows.add("write", labels, [perf_counter_ns() - start])
    rows.add("file", labels, [path.stat().st_size / len(tree.records)], "B")
    rows.time_lookups(library, "core", {**labels, "where": "loaded"}, queries, sizes)
    start = perf_counter_ns()
    library.buffer = Buffer.open(path)
    rows.add("open", labels, [perf_counter_ns() - start])
    rows.time_lookups(library, "core", {**labels, "where": "opened"}, queries, sizes)
