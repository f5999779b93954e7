"""Measure frozen files: writing one, opening it, looking up in it, and worker processes that share it."""

import multiprocessing
import random
import re
import time
from pathlib import Path
from statistics import median
from time import perf_counter_ns, process_time_ns

import numpy as np
from trees_and_queries import bushy

HOPS = 4
DEADLINE_S = 120.0
# Of each worker after its lookups, in bytes: what it does not share, and its share of all it maps.
FACTS = ("Private_Clean", "Private_Dirty", "Pss")


def frozen(rows, sizes, library):
    """A tree of 50 frames: the file, and lookups in a process that opens it."""
    tree = _tree(sizes)
    labels = {"samples": len(tree.records)}
    path = Path(sizes.folder, f"{type(library).__name__}.frozen")
    library.fill(tree)
    for _ in range(2):  # the first one also gets the file's blocks
        start = perf_counter_ns()
        library.freeze(path)
        took = perf_counter_ns() - start
    rows.add("write", labels, [took])
    rows.add("file", labels, [path.stat().st_size / len(tree.records)], "B")
    rows.add("random pose, loaded", labels, _time_poses(library, tree, sizes))
    opening, computing, first, random_poses = [], [], [], []
    for _ in range(3):
        start, start_computing = perf_counter_ns(), process_time_ns()
        library.open(path)
        opening.append(perf_counter_ns() - start)
        computing.append(process_time_ns() - start_computing)
        function, calls = library.calls(library.ways[0], _queries(tree, 1))
        start = perf_counter_ns()
        function(*calls[0])
        first.append(perf_counter_ns() - start)
        random_poses.append(_time_poses(library, tree, sizes))
    rows.add("open", labels, opening)
    rows.add("open, CPU time", labels, computing)
    rows.add("first lookup", labels, first)
    # The first time, the process has not mapped most pages.
    rows.add("random pose, opened", labels, np.concatenate(random_poses))
    rows.add(f"{sizes.frozen_lookups:,} random poses", labels, [sum(one) for one in random_poses])


def workers(rows, sizes, library):
    """Spawned workers that open the file and look up, and others that only import the library."""
    tree = _tree(sizes)
    path = Path(sizes.folder, f"{type(library).__name__}.frozen")
    if not path.exists():  # the other section has not written it
        library.fill(tree)
        library.freeze(path)
    library.open(path)
    handed = library.for_worker(path)
    labels = {"workers": sizes.frozen_workers, "samples": len(tree.records)}
    queries = _queries(tree, sizes.frozen_lookups)
    empty = _spawned(type(library), None, queries, sizes.frozen_workers)
    opened = _spawned(type(library), handed, queries, sizes.frozen_workers)
    size = path.stat().st_size
    rows.add("start-up, more than an empty worker", labels, [_more(opened, empty, "ready_ns")])
    rows.add("start-up of an empty worker", labels, [median(one["ready_ns"] for one in empty)])
    rows.add(
        "private memory, more than an empty worker", labels, [_more(opened, empty, "private") / 1e6], "MB"
    )
    shared = sum(one["Pss"] for one in opened) - sum(one["Pss"] for one in empty)
    rows.add("PSS of all, more than empty workers, for each byte of the file", labels, [shared / size], "x")


def _tree(sizes):
    samples = sizes.frozen_samples // sizes.frozen_frames
    return bushy("frozen", sizes.frozen_frames + 1, 1.0, samples, cache_s=samples)


def _queries(tree, count):
    """Queries of frames 4 hops apart, at random times."""
    pairs = tree.pairs(HOPS, 20)
    random.Random(1).shuffle(pairs)
    return tree.queries(pairs, tree.times("random", count))


def _time_poses(library, tree, sizes):
    function, calls = library.calls(library.ways[0], _queries(tree, sizes.frozen_lookups))
    times = []
    for arguments in calls:
        start = perf_counter_ns()
        function(*arguments)
        times.append(perf_counter_ns() - start)
    return times


# Workers.


def _more(some, others, what):
    return median(one[what] for one in some) - median(one[what] for one in others)


def _spawned(make, handed, queries, count):
    """Start workers, let all look up before any ends, and return their facts."""
    context = multiprocessing.get_context("spawn")
    barrier, results = context.Barrier(count), context.Queue()
    processes = []
    for _ in range(count):
        arguments = (make, handed, queries, time.monotonic_ns(), barrier, results)
        processes.append(context.Process(target=_work, args=arguments))
        processes[-1].start()
    found = [results.get(timeout=DEADLINE_S) for _ in processes]
    for process in processes:
        process.join(DEADLINE_S)
    return found


def _work(make, handed, queries, begun_ns, barrier, results):
    library = make()
    if handed is not None:
        library.take(handed)
    ready_ns = time.monotonic_ns() - begun_ns
    if handed is not None:
        function, calls = library.calls(library.ways[0], queries)
        for arguments in calls:
            function(*arguments)
    barrier.wait(DEADLINE_S)
    text = Path("/proc/self/smaps_rollup").read_text()
    facts = {name: 1024 * int(re.search(rf"^{name}: +(\d+) kB$", text, re.M)[1]) for name in FACTS}
    barrier.wait(DEADLINE_S)
    private = facts["Private_Clean"] + facts["Private_Dirty"]
    results.put({"ready_ns": ready_ns, "private": private, "Pss": facts["Pss"]})
