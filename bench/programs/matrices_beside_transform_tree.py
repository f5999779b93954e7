"""
Matrices beside transform-tree, in one process and in turn, so that the load of the machine affects both.

Run: pip install --no-deps --target .bench/beside transform-tree==0.0.9
     PYTHONPATH=.bench/beside:. python -O bench/programs/matrices_beside_transform_tree.py
"""

import os
import statistics
from time import perf_counter_ns

from lookups import HOPS, MOVING_SAMPLES
from our_library import Ours
from transform_tree import TfTree
from trees_and_queries import chain

CALLS = 200  # in a block, after which it is the other's turn
BLOCKS = 500
TIMES = 10_000  # in one call for many times
ROUNDS = 100


def in_turn(ways, blocks):
    """The median ns of each way, and of its ratio to the last way in the same round."""
    taken = {name: [] for name in ways}
    for block in range(blocks):
        for name in sorted(ways, reverse=block % 2 == 1):
            taken[name].append(ways[name](block))
    *_, last = ways
    for name, times in taken.items():
        ratios = [time / other for time, other in zip(times, taken[last], strict=True)]
        yield f"{name} {statistics.median(times):.0f} ns ({statistics.median(ratios):.2f})"


def one_by_one(library, way, queries):
    function, arguments = library.calls(way, queries)
    arguments = list(arguments)

    def take(block):
        part = arguments[block * CALLS : (block + 1) * CALLS]
        start = perf_counter_ns()
        for one in part:
            function(*one)
        return (perf_counter_ns() - start) / CALLS

    return take


def at_once(library, way, queries):
    function, (arguments,) = library.calls(way, queries)

    def take(_):
        start = perf_counter_ns()
        function(*arguments)
        return (perf_counter_ns() - start) / TIMES

    return take


def main():
    tree = chain("moving chain", HOPS[-1], MOVING_SAMPLES)
    ours, other = Ours(), TfTree()
    for library in (ours, other):
        library.load(tree)
    print(f"load {os.getloadavg()[0]:.1f}")
    for hops in HOPS:
        queries = tree.queries([(0, hops)], tree.times("random", CALLS * BLOCKS))
        ways = {
            "lookup_matrix": one_by_one(ours, "matrix", queries),
            "lookup_matrix with out": one_by_one(ours, "matrix out", queries),
            "transform-tree, plan": one_by_one(other, "plan", queries),
        }
        print(f"one random time, hops {hops}:", *in_turn(ways, BLOCKS), sep="  ")
    for place in ("sorted", "random"):
        for hops in HOPS:
            queries = tree.vector_queries([(0, hops)], place, TIMES)
            ways = {
                "lookup_transforms": at_once(ours, "vector", queries),
                "lookup_matrices": at_once(ours, "vector matrices", queries),
                "transform-tree, plan": at_once(other, "vector", queries),
            }
            print(f"{TIMES} {place} times, hops {hops}, each:", *in_turn(ways, ROUNDS), sep="  ")
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
