# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""tf2 for C++; the loops run in C++ (tf2_cpp.cpp, compiled to $TF2_CPP)."""

import os
from ctypes import CDLL, POINTER, c_char_p, c_double, c_int64, c_size_t, c_void_p

import numpy as np
from measured_library import MeasuredLibrary
from trees_and_queries import QUERY, RECORD

EMPTY = 1000
UNLIMITED_S = 1e6
TIMES = POINTER(c_int64)
FUNCTIONS = {
    "buffer_new": (c_void_p, c_int64, POINTER(c_char_p), c_size_t),
    "buffer_free": (None, c_void_p),
    "buffer_insert": (c_size_t, c_void_p, c_void_p, c_size_t, c_double, TIMES),
    "buffer_look_up": (c_size_t, c_void_p, c_void_p, c_size_t, c_size_t, c_double, TIMES),
    "time_nothing": (None, c_size_t, TIMES),
}


class Tf2(MeasuredLibrary):
    def __init__(self):
        self.tf2, self.buffer = CDLL(os.environ["TF2_CPP"]), None
        for name, (result, *arguments) in FUNCTIONS.items():
            function = getattr(self.tf2, name)
            function.restype, function.argtypes = result, arguments

    def load(self, tree):
        if self.buffer is not None:
            self.tf2.buffer_free(self.buffer)
        self.index = {name: i for i, name in enumerate(tree.names)}
        names = (c_char_p * len(tree.names))(*(name.encode() for name in tree.names))
        self.buffer = self.tf2.buffer_new(tree.cache_ns, names, len(names))
        self._insert(tree.records, UNLIMITED_S)

    def _insert(self, records, budget_s):
        ns = (c_int64 * len(records))()
        return ns[: self.tf2.buffer_insert(self.buffer, records.ctypes.data, len(records), budget_s, ns)]

    def _look_up(self, queries, count, budget_s):
        found = np.array([(self.index[a], self.index[b], at) for a, b, at in queries], QUERY)
        ns = (c_int64 * count)()
        return ns[: self.tf2.buffer_look_up(self.buffer, found.ctypes.data, len(found), count, budget_s, ns)]

    def calls(self, way, queries):
        return self._look_up, queries

    def inserts(self, way, transforms):
        index = self.index
        records = [(index[child], index[parent], 0, 0, ns, pose) for child, parent, ns, pose in transforms]
        return self._insert, records, 1

    def time(self, function, calls, count, budget_s):
        empty = (c_int64 * EMPTY)()
        self.tf2.time_nothing(EMPTY, empty)
        if function == self._look_up:
            tried = np.array(function(calls, count, budget_s))
        else:
            tried = np.array(function(np.array(calls[:count], RECORD), budget_s))
        times = tried[tried >= 0]
        return times - np.median(empty), len(tried) - len(times)
