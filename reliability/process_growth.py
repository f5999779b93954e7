# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a process uses after each round of a stress run, and what of that grows."""

import ctypes
import gc
import os
import statistics
import sys
from itertools import combinations
from pathlib import Path

WARM_UP_SHARE = 4  # one round in so many, in which the middleware and the allocator fill what they keep
FEWEST = 6  # rounds after these, from which a rise can be told
# How much each may rise between the first and the last round after the warm-up.
BOUNDS = {"resident": 8e6, "heap": 4e6, "blocks": 5000.0, "threads": 1.5, "descriptors": 1.5}


class Mallinfo2(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()
    ]


def sample():
    """What this process uses now."""
    gc.collect()
    libc = ctypes.CDLL(None)
    libc.malloc_trim(0)
    mallinfo2 = libc.mallinfo2
    mallinfo2.restype = Mallinfo2
    heap = mallinfo2()
    lines = (line.split() for line in Path("/proc/self/status").read_text().splitlines())
    status = {line[0]: line[1] for line in lines if len(line) > 1}
    return {
        # Without the memory that Fast DDS shares with other processes.
        "resident": int(status["RssAnon:"]) * 1024,
        "heap": heap.uordblks + heap.hblkhd,
        "blocks": sys.getallocatedblocks(),
        "threads": int(status["Threads:"]),
        "descriptors": len(os.listdir("/proc/self/fd")),
    }


def rises(samples):
    """
    By how much each quantity rises over these samples: the median slope of all pairs, times their number.

    A few samples far off, such as those of rounds on a busy machine, change nothing.
    """
    return {
        name: (len(samples) - 1)
        * statistics.median(
            (b[name] - a[name]) / (j - i) for (i, a), (j, b) in combinations(enumerate(samples), 2)
        )
        for name in BOUNDS
    }


def growth(samples):
    """Describe what rises by more than its bound; an empty list if nothing does."""
    warm = samples[len(samples) // WARM_UP_SHARE :]
    if len(warm) < FEWEST:
        return []
    return [
        f"{name} rises by {rise:,.1f} in {len(warm)} rounds, and may by {BOUNDS[name]:,.1f}"
        for name, rise in rises(warm).items()
        if rise >= BOUNDS[name]
    ]
