# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure inserts into full histories, and the memory that samples take."""

import ctypes
import itertools
import os

from measured_library import STEP_NS
from trees_and_queries import bushy, chain

FRAMES = 50
CACHE_S = 10.0
# Longer than the cache, so that every insert drops an old sample, as in a program that runs for long.
SAMPLES = round(CACHE_S * 100) + 100
MEMORY_SAMPLES = 10_000  # of one frame: 100 s
POSE = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]


class Following:
    """Transforms that continue the histories of some (child, parent), in turn."""

    def __init__(self, start_ns, links):
        stamps = itertools.count(start_ns, STEP_NS)
        self._transforms = ((*link, ns, POSE) for ns in stamps for link in links)

    def take(self, count):
        return list(itertools.islice(self._transforms, count))


def inserts(rows, sizes, library):
    """By message, batch and serialized message."""
    tree = bushy("inserts", FRAMES + 1, 1.0, SAMPLES, CACHE_S)
    library.load(tree)
    links = [(tree.names[child], tree.names[parent]) for child, parent in tree.links]
    following = Following(tree.newest_ns + 2 * STEP_NS, links)
    for way in library.insert_ways:
        for count in (sizes.warm_up, sizes.inserts):
            function, calls, batch = library.inserts(way, following.take(count))
            times, failed = library.time(function, calls, len(calls), sizes.budget_s)
        rows.add(way, {"frames": FRAMES}, times / batch, failed=failed)


def memory(rows, sizes, library):
    """Bytes that the process holds for each sample."""
    tree = chain("memory", max(1, sizes.resident_samples // MEMORY_SAMPLES), MEMORY_SAMPLES)
    samples, before = len(tree.records), rss_bytes()
    library.load(tree)
    rows.add("resident", {"samples": samples}, [(rss_bytes() - before) / samples], "B")


def rss_bytes():
    """What the process holds now, without what its allocator only keeps for later."""
    ctypes.CDLL(None).malloc_trim(0)
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
