"""Obey orders in the measured process: load trees and time each call in a loop.

Standard library only, and no newer Python than a distribution's: other interpreters run this file, too.
"""

import ctypes
import itertools
import json
import os
import struct
import sys
import time
import traceback
from time import perf_counter_ns

RECORD = struct.Struct("<IIIIq7d")  # child, parent, static, 0, stamp in ns, x y z, qx qy qz qw
QUERY = struct.Struct("<IIq")  # target, source, time in ns (0: latest)
CHUNK = 4096  # records read at a time
AUTHORITY = "bench"
STEP_NS = 10_000_000  # from insert to insert

# One text for every number of arguments, as timeit does it: a call with `*arguments` would cost extra.
LOOP = """
def loop(function, calls, stop_ns, clock, add):
    failed = 0
    for {names} in calls:
        start = clock()
        try:
            result = {call}
        except Exception:
            result = None
        end = clock()
        if result is None and {must_answer}:
            failed += 1
        else:
            add(end - start)
        if end > stop_ns:
            break
    return failed
"""


def make_loop(arity, empty=False, must_answer=True):
    names = ", ".join(f"a{i}" for i in range(arity)) + ","
    text = LOOP.format(names=names, call="True" if empty else f"function({names})", must_answer=must_answer)
    scope = {}
    exec(text, scope)
    return scope["loop"]


def time_calls(function, calls, count, budget_s, must_answer=True):
    """
    Time `count` calls one by one, going round `calls`; fewer where the budget is used up.

    :return: ns of each successful call, how many failed, ns of the same loop without the call.
    """
    arity = len(calls[0])
    stop_ns = perf_counter_ns() + int(budget_s * 1e9)
    empty = []
    round_and_round = itertools.islice(itertools.cycle(calls), min(count, 1000))
    make_loop(arity, empty=True)(function, round_and_round, stop_ns, perf_counter_ns, empty.append)
    times = []
    round_and_round = itertools.islice(itertools.cycle(calls), count)
    loop = make_loop(arity, must_answer=must_answer)
    failed = loop(function, round_and_round, stop_ns, perf_counter_ns, times.append)
    return times, failed, sorted(empty)[len(empty) // 2]


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


class Tree:
    """A tree of frames with its history, read from a file that `bench.trees` wrote."""

    def __init__(self, path):
        self._path = path
        with open(path, "rb") as file:
            words = file.readline().split()
            name_count, self.record_count, self.cache_ns, self.newest_ns = map(int, words)
            self.names = [file.readline().decode().rstrip("\n") for _ in range(name_count)]
            self._start = file.tell()

    def chunks(self):
        """Bytes of many records each."""
        with open(self._path, "rb") as file:
            file.seek(self._start)
            while data := file.read(RECORD.size * CHUNK):
                yield data

    def records(self):
        """(child, parent, static, stamp in ns, pose) of each transform, in the order of arrival."""
        names = self.names
        for data in self.chunks():
            for child, parent, static, _, stamp_ns, *pose in RECORD.iter_unpack(data):
                yield names[child], names[parent], bool(static), stamp_ns, pose

    def queries(self, path):
        """(target, source, time in ns) of each query in a file."""
        with open(path, "rb") as file:
            return [
                (self.names[target], self.names[source], time_ns)
                for target, source, time_ns in QUERY.iter_unpack(file.read())
            ]


def by_pair(queries):
    """(target, source, times in ns) of each run of queries between the same two frames: one vector lookup."""
    return [
        (target, source, [ns for _, _, ns in run])
        for (target, source), run in itertools.groupby(queries, lambda query: query[:2])
    ]


def rss_bytes():
    """What the process holds now, without what its allocator only keeps for later."""
    ctypes.CDLL(None).malloc_trim(0)
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


class Contestant:
    """
    One library under measurement. A subclass defines its calls:

    `about()`: a dict with `version`, and what a lookup `returns`.
    `load(tree)`: make a new buffer and fill it.
    `calls(way, queries)`: a function and the argument tuples, one for each query, for a way of looking up.
    `numbers(answer)`: x y z qx qy qz qw of what the function returned.
    `load_recording(path)`: the same of a recording.
    `inserts(way, transforms)`: a function, the argument tuples, and how many transforms each call carries.
    """

    time = staticmethod(time_calls)

    def __init__(self):
        self.tree = None
        self.sets = {}
        self.moving = []
        self.next_ns = 0

    def order_about(self):
        version = "{}.{}.{}".format(*sys.version_info[:3])
        return {"python": version, **self.about()}

    def order_load(self, path, keep):
        """Load a tree. Those before are dropped, with their sets of queries, unless they are to be kept."""
        if not keep:
            self.sets.clear()
        before = rss_bytes()
        start = perf_counter_ns()
        self.tree = Tree(path)
        self.load(self.tree)
        self.moving = []
        self.next_ns = self.tree.newest_ns + 2 * STEP_NS
        return {"seconds": (perf_counter_ns() - start) / 1e9, "rss_bytes": rss_bytes() - before}

    def order_load_recording(self, tree, path):
        """Load a recording of a tree; what was loaded before is dropped first, and its sets of queries."""
        self.sets.clear()
        self.tree = Tree(tree)
        self.buffer = None
        start = perf_counter_ns()
        self.load_recording(path)
        return {"ns": perf_counter_ns() - start}

    def order_prepare(self, way, name, path, check):
        """Prepare a set of queries; the numbers of the first few answers show that all mean the same."""
        function, calls = self.calls(way, self.tree.queries(path))
        self.sets[way, name] = function, calls
        answers = []
        for arguments in calls[:check]:
            try:
                answer = function(*arguments)
            except Exception:
                answer = None
            answers.append(None if answer is None else [float(v) for v in self.numbers(answer)])
        return {"answers": answers}

    def order_time(self, way, name, count, budget_s):
        function, calls = self.sets[way, name]
        # Others have run since, and the caches of the machine have forgotten these queries.
        self.time(function, calls, min(len(calls), count), budget_s / 2)
        times, failed, empty = self.time(function, calls, count, budget_s)
        return {"ns": times, "failed": failed, "empty_ns": empty}

    def order_insert(self, way, count, budget_s):
        """Time inserts that continue where the histories of the tree's dynamic frames end."""
        if not self.moving:
            moving = {
                child: (child, parent, pose)
                for child, parent, static, _, pose in self.tree.records()
                if not static
            }
            self.moving = list(moving.values())
        transforms = []
        while len(transforms) < count:
            transforms += [(child, parent, self.next_ns, pose) for child, parent, pose in self.moving]
            self.next_ns += STEP_NS
        function, calls, batch = self.inserts(way, transforms)
        times, failed, empty = self.time(function, calls, len(calls), budget_s, must_answer=False)
        return {"ns": times, "failed": failed, "empty_ns": empty, "batch": batch}


class Tf2(Contestant):
    """
    tf2 for Python. A subclass says how the ROS at hand makes its objects:

    `message`: the class of a TransformStamped.
    `stamp_of(ns)`, `time_of(ns)`: a message's stamp, the time of a lookup.
    `buffer_of(cache_ns)`: an empty buffer.
    """

    def load(self, tree):
        self.buffer = self.buffer_of(tree.cache_ns)
        message = self.message()
        for child, parent, static, stamp_ns, pose in tree.records():
            fill_transform(message, child, parent, self.stamp_of(stamp_ns), pose)
            if static:
                self.buffer.set_transform_static(message, AUTHORITY)
            else:
                self.buffer.set_transform(message, AUTHORITY)

    def calls(self, way, queries):
        function = self.buffer.lookup_transform if way == "buffer" else self.buffer.lookup_transform_core
        return function, [(target, source, self.time_of(ns)) for target, source, ns in queries]

    def numbers(self, answer):
        t, q = answer.transform.translation, answer.transform.rotation
        return t.x, t.y, t.z, q.x, q.y, q.z, q.w

    def inserts(self, way, transforms):
        return self.buffer.set_transform, [(message, AUTHORITY) for message in self.messages(transforms)], 1

    def messages(self, transforms):
        return [
            fill_transform(self.message(), child, parent, self.stamp_of(stamp_ns), pose)
            for child, parent, stamp_ns, pose in transforms
        ]


def fill_transform(message, child, parent, stamp, pose):
    message.header.frame_id, message.child_frame_id = parent, child
    message.header.stamp = stamp
    translation, rotation = message.transform.translation, message.transform.rotation
    translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z, rotation.w = pose
    return message


def serve(contestant, end=None):
    """
    Take orders from standard input, each a line of JSON: its name and arguments; answer with a line of JSON.

    :param end: called when the input ends.
    """
    # Libraries print to standard output when they please.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        order, *arguments = json.loads(line)
        try:
            answer = getattr(contestant, "order_" + order)(*arguments)
        except Exception as error:
            traceback.print_exc()
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
    if end is not None:
        end()
