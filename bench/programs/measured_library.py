"""
A measured library, how its calls are timed, and the rows of results.

`measured_library.py LIBRARY MODULE.FUNCTION SIZES OUT [VARIANT...]` measures: a process measures one section
of one library, and writes its rows to the file OUT. The processes run under the interpreters of the
libraries, so everything in this folder needs nothing but the standard library and NumPy, unless only ours
imports it.
"""

import importlib
import itertools
import json
import sys
import time
import types
from time import perf_counter_ns

import numpy as np

# Module and class of each library.
CLASSES = {
    "ours": ("our_library", "Ours"),
    "ros2": ("tf2_python", "Tf2"),
    "ros2_cpp": ("tf2_cpp", "Tf2"),
    "ros1_cpp": ("tf2_cpp", "Tf2"),
    "schiebung": ("rust_libraries", "Schiebung"),
    "tf_tree": ("rust_libraries", "TfTree"),
}
AUTHORITY = "bench"
STEP_NS = 10_000_000  # from insert to insert
CHECKED = 5  # answers that are compared with ours
QUANTILES = np.linspace(0, 1, 201)  # of the values of a row that are kept

# A text for every number of arguments, as timeit has one: a call with `*arguments` would cost extra.
LOOP = """
def loop(function, calls, stop_ns, clock, add):
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


def time_paced(function, calls, pause_s=0.0):
    """ns of each call, after a pause: others use the machine's caches, and insert, meanwhile."""
    times = []
    for arguments in calls:
        if pause_s:
            time.sleep(pause_s)
        start = perf_counter_ns()
        function(*arguments)
        times.append(perf_counter_ns() - start)
    return times


def by_pair(queries):
    """(target, source, times in ns) of each run of queries between the same two frames: one vector lookup."""
    for (target, source), run in itertools.groupby(queries, lambda query: query[:2]):
        yield target, source, np.array([ns for _, _, ns in run])


class Library:
    """
    A library under measurement. A subclass defines its calls:

    `load(tree)`: make a new buffer and fill it.
    `calls(way, queries)`: a function and its arguments, of each (target, source, time in ns; 0: latest).
    `numbers(answer)`: x y z qx qy qz qw of what the function returned.
    `fill`, `freeze`, `open`, `for_worker` and `take`: of those with frozen files; see `frozen.py`.
    `inserts(way, transforms)`: a function, its arguments, and how many transforms a call carries.
    """

    ways = ("core",)  # of a single lookup, the usual one first
    vector_ways = ()  # of lookups at many times, the usual one first
    insert_ways = ("set_transform",)
    counts_bytes = False  # whether its buffer has `statistics()`

    def time(self, function, calls, count, budget_s):
        """
        Time `count` calls one by one, going round `calls`; fewer where the budget is used up.

        :return: ns of each successful call, without those of the empty loop, and how many failed.
        """
        arity, stop_ns = len(calls[0]), perf_counter_ns() + round(budget_s * 1e9)
        empty, times = [], []
        for call, most, found in ("pass", min(count, 1000), empty), ("function({})", count, times):
            round_and_round = itertools.islice(itertools.cycle(calls), most)
            failed = make_loop(arity, call)(function, round_and_round, stop_ns, perf_counter_ns, found.append)
        return np.array(times) - np.median(empty), failed


class Rows(list):
    """What a process has measured."""

    def add(self, way, labels, values, unit="ns", failed=0, answers=()):
        """
        Add a row.

        :param labels: what was measured: texts, and numbers by their units.
        :param failed: how many calls failed; `values` are those of the others.
        :param answers: the numbers of the first answers; the others' are compared with ours.
        """
        values = np.asarray(values, float)
        if len(values) > len(QUANTILES):
            values = np.quantile(values, QUANTILES)
        if len(values):
            row = {"way": way, "labels": labels, "unit": unit, "values": values.tolist()}
            self.append({**row, "failed": failed, "answers": list(answers)})

    def time_lookups(self, library, way, labels, queries, sizes, per=1):
        """
        Add the row of lookups.

        :param per: transforms that one call looks up.
        """
        function, calls = library.calls(way, queries)
        answers = []
        for arguments in calls[:CHECKED]:
            try:
                answers.append([float(number) for number in library.numbers(function(*arguments))])
            except Exception:
                answers.append(None)
        library.time(function, calls, sizes.warm_up if per == 1 else 2, sizes.budget_s)
        times, failed = library.time(function, calls, max(len(calls), sizes.calls // per), sizes.budget_s)
        self.add(way, labels, times / per, failed=failed, answers=answers)


def main(name, section, sizes, out, *variant):
    module, function = section.split(".")
    library_module, library = CLASSES[name]
    make = getattr(importlib.import_module(library_module), library)
    rows = Rows()
    sizes = types.SimpleNamespace(**json.loads(sizes))
    getattr(importlib.import_module(module), function)(rows, sizes, make(), *variant)
    with open(out, "w") as file:
        json.dump(rows, file)


if __name__ == "__main__":
    # The other modules import this one by its name, which must be the same one.
    sys.modules["measured_library"] = sys.modules["__main__"]
    main(*sys.argv[1:])
