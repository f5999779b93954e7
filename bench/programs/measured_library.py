# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The base class of the measured libraries; it times their calls one by one.

The processes run under the interpreters of the libraries, so everything in this folder needs nothing but the
standard library and NumPy, unless only ours imports it.
"""

import collections
import itertools
from time import perf_counter_ns

import numpy as np

AUTHORITY = "bench"
STEP_NS = 10_000_000  # from insert to insert
KEPT = 64

# A text for every number of arguments, as timeit has one: a call with `*arguments` would cost extra.
LOOP = """
def loop(function, calls, stop_ns, clock, add, keep):
    failed = 0
    for {names} in calls:
        start = clock()
        try:
            {call}
        except Exception:
            start = None
        end = clock()
        if start is None:
            failed += 1
        else:
            add(end - start)
        if end > stop_ns:
            break
    return failed
"""


def make_loop(arity, call):
    names = "".join(f"a{i}, " for i in range(arity))
    scope = {}
    exec(LOOP.format(names=names or "()", call=call.format(names)), scope)
    return scope["loop"]


def by_pair(queries):
    """(target, source, times in ns) of each run of queries between the same two frames: one vector lookup."""
    for (target, source), run in itertools.groupby(queries, lambda query: query[:2]):
        yield target, source, np.array([ns for _, _, ns in run])


class MeasuredLibrary:
    """
    A library under measurement. A subclass defines its calls:

    `load(tree)`: make a new buffer and fill it.
    `calls(way, queries)`: a function and its arguments, of each (target, source, time in ns; 0: latest).
    `inserts(way, transforms)`: a function, its arguments, and how many transforms a call carries.
    """

    ways = ("core",)  # of a single lookup, the usual one first
    vector_ways = ()  # of lookups at many times, the usual one first
    insert_ways = ("set_transform",)
    call = "function({})"  # "keep(function({}))": with the last KEPT results

    def time(self, function, calls, count, budget_s):
        """
        Time `count` calls one by one, going round `calls`; fewer where the budget is used up.

        :return: ns of each successful call, without those of the empty loop, and how many failed.
        """
        arity, stop_ns = len(calls[0]), perf_counter_ns() + round(budget_s * 1e9)
        empty, times = [], []
        keep = collections.deque(maxlen=KEPT).append
        for call, most, found in ("pass", min(count, 1000), empty), (self.call, count, times):
            turns = itertools.islice(itertools.cycle(calls), most)
            failed = make_loop(arity, call)(function, turns, stop_ns, perf_counter_ns, found.append, keep)
        return np.array(times) - np.median(empty), failed
