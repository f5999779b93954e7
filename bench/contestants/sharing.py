"""
A buffer that processes share. The arguments are what the process is, and the name of the buffer:

`owner`: shares a buffer, and inserts into it.
`reader`: attaches to it, and has a private buffer beside, into which it inserts the same.
"""

import ctypes
import itertools
import re
import sys
from time import perf_counter_ns

import numpy as np
from listening import Looking
from ours import Ours
from publishing import Sending
from rclpy.duration import Duration
from ros2_tf2 import Ros2
from serving import AUTHORITY, STEP_NS, Tree, serve, time_paced

from tf2_ros import Buffer

PACE_S = 0.01  # between two lookups of a program that does little else
KINDS_OF_MEMORY = {"Rss": ("Rss",), "Pss": ("Pss",), "private": ("Private_Clean", "Private_Dirty")}
TIMES = 20_000  # within a history: more than it has samples


class Continuing(Sending):
    """Continues, in `own`, the histories of a tree's moving frames."""

    own = None  # a buffer

    def __init__(self):
        super().__init__(lambda data: self.own.set_transforms_cdr(data, AUTHORITY))

    def load(self, tree):
        super().load(tree)
        self.own = self.buffer
        self.start_ns, self.step_ns = tree.newest_ns + 2 * STEP_NS, STEP_NS
        parents = {child: parent for child, parent, static, _, _ in tree.records() if not static}
        self.links = [(parent, child) for child, parent in parents.items()]


class Owner(Continuing, Ros2):
    def __init__(self, name):
        super().__init__()
        self._name = name

    def buffer_of(self, cache_ns):
        return Buffer(Duration(nanoseconds=cache_ns), share=self._name)

    def order_new(self, cache_s):
        """Share an empty buffer."""
        self.own = self.buffer_of(cache_s * 10**9)
        return {}


class Reader(Continuing, Looking, Ours):
    def __init__(self, name):
        super().__init__()
        self._name = name

    def order_use(self, which):
        """Prepare queries, and wait, in this one from now on: `private` or `attached`."""
        self.buffer = self.own if which == "private" else Buffer(attach=self._name)
        return {}

    def order_attach(self, count):
        """Ns of attaching buffers that are empty until then, one after the other."""
        times = []
        for _ in range(count):
            start = perf_counter_ns()
            buffer = Buffer(attach=self._name)
            buffer._frameExists("")  # the first look reads what the ring holds
            times.append(perf_counter_ns() - start)
            del buffer
        return {"ns": times}

    def order_paced(self, way, name, count):
        """Time calls with pauses between them."""
        function, calls = self.sets[way, name]
        round_and_round = itertools.islice(itertools.cycle(calls), count)
        return {"ns": time_paced(function, round_and_round, PACE_S)}

    def order_memory(self, which, path, first_ns, newest_ns):
        """Bytes by which this process grows with a buffer, each of whose samples it reads."""
        self.tree = tree = Tree(path)
        times = first_ns + np.linspace(0, newest_ns - first_ns, TIMES).astype(np.int64)
        self.buffer = self.buffer_of(tree.cache_ns)
        before = memory_bytes()
        if which == "private":
            self.load(tree)
        else:
            self.order_use(which)
        links = {(parent, child) for child, parent, _, _, _ in tree.records()}
        for parent, child in links:
            self.buffer.lookup_transforms(parent, child, times)
        del links
        return {kind: bytes_ - before[kind] for kind, bytes_ in memory_bytes().items()}


def memory_bytes():
    """By kind: resident; its part of what several processes have; what no other process has."""
    ctypes.CDLL(None).malloc_trim(0)
    with open("/proc/self/smaps_rollup") as file:
        kilobytes = dict(re.findall(r"^(\w+): +(\d+) kB$", file.read(), re.MULTILINE))
    return {
        kind: 1024 * sum(int(kilobytes[name]) for name in names) for kind, names in KINDS_OF_MEMORY.items()
    }


if __name__ == "__main__":
    what, name = sys.argv[1:]
    contestant = {"owner": Owner, "reader": Reader}[what](name)
    serve(contestant, contestant.end)
