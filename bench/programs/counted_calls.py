# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Make calls of this project between marks, so that bench/instruction_counts.py can count their instructions.

`counted_calls.py CASE=COUNT...` makes, of each case, COUNT calls and then twice as many. A case is a name, or
one of CALLS.
"""

import ctypes
import functools
import gc
import os
import sys

from call_texts import CALLS, EMPTY
from calls import COUNTED, looping, objects_of
from inserts_and_memory import Following
from measured_library import STEP_NS
from our_library import BATCH, Ours
from trees_and_queries import Tree, chain

WARM_UP = 20
HOPS = 4
SAMPLES = 300  # per frame
VECTOR_TIMES = 1000
PLACES = ("static", "past", "latest")


class Point:
    def __init__(self, x, name):
        self.x = x
        self.name = name


def reference(table, name, x):
    """What Python itself costs here: calls, a dict, attributes, floats, small objects."""
    total = x
    for k in range(10):
        point = Point(total + k, name)
        table[name] = point.x * 0.5
        total = table[name] + point.x
    return total


def case(name, count):
    """A function and `count` argument tuples."""
    if name == "reference":
        return reference, [({}, "frame", float(i)) for i in range(count)]
    library, tree, place = Ours(), chain("chain", HOPS, SAMPLES), name.split()[-1]
    if place == "static":
        tree = Tree("static", tree.parents, [False] * (HOPS + 1), 0)
    if name.startswith("set_"):
        tree.cache_ns = SAMPLES * STEP_NS  # full, so that every further sample drops the oldest
    library.load(tree)
    if place in PLACES:
        return library.calls("buffer", tree.queries([(0, HOPS)], tree.times(place, count)))
    if name == "lookup_transforms":
        function, calls = library.calls("vector", tree.vector_queries([(0, HOPS)], "sorted", VECTOR_TIMES))
        return function, calls * count
    following = Following(tree.newest_ns + 2 * STEP_NS, [(tree.names[1], tree.names[0])])
    transforms = following.take(count * (BATCH if name == "set_transforms_cdr" else 1))
    return library.inserts(name, transforms)[:2]


def run(function, calls):
    for arguments in calls:
        function(*arguments)


def counted_call(call):
    """A function that makes one of CALLS, or nothing, in each of some turns."""
    objects = objects_of(call, Ours())
    return functools.partial(looping(call, COUNTED, objects), **objects)


def mark():
    # callgrind writes its counts whenever this C function is entered; nothing else calls it.
    os.getpgid(0)


def main(cases):
    # A collection within a run would add hundreds of instructions to each call, and where it falls depends
    # on what was allocated before.
    gc.disable()
    for name, count in cases:
        if name in CALLS or name == EMPTY:
            repeat, calls = counted_call(name), range(WARM_UP + 3 * count)
        else:
            function, calls = case(name, WARM_UP + 3 * count)
            repeat = functools.partial(run, function)
        repeat(calls[:WARM_UP])
        # glibc merges freed pieces of memory at a moment that depends on what ran before. Within the shorter
        # run, its 90,000 instructions made a call seem 15 % cheaper.
        ctypes.CDLL(None).malloc_trim(0)
        mark()
        repeat(calls[WARM_UP : WARM_UP + count])
        mark()
        repeat(calls[WARM_UP + count :])
        mark()


if __name__ == "__main__":
    main((name, int(count)) for name, count in (one.rsplit("=", 1) for one in sys.argv[1:]))
