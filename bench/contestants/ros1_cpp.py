"""Owns the calls of ROS 1's tf2 for C++, as Debian packages it: the loops run in C++ (ros1_cpp.cpp)."""

import itertools
import os
import sys
from ctypes import CDLL, POINTER, Structure, c_bool, c_char_p, c_double, c_int64, c_size_t, c_void_p

from serving import Contestant, serve

CHUNK = 4096  # transforms inserted at a time while a tree is loaded
EMPTY = 1000
UNLIMITED_S = 1e6


class Transform(Structure):
    _fields_ = [
        ("child", c_char_p),
        ("parent", c_char_p),
        ("is_static", c_int64),
        ("stamp_ns", c_int64),
        ("pose", c_double * 7),
    ]


class Query(Structure):
    _fields_ = [("target", c_char_p), ("source", c_char_p), ("time_ns", c_int64)]


def library(path):
    loaded = CDLL(path)
    times = POINTER(c_int64)
    for name, result, *arguments in (
        ("buffer_new", c_void_p, c_int64),
        ("buffer_free", None, c_void_p),
        ("buffer_insert", c_size_t, c_void_p, POINTER(Transform), c_size_t, c_double, times),
        ("buffer_look_up", c_size_t, c_void_p, POINTER(Query), c_size_t, c_size_t, c_double, times),
        ("buffer_answer", c_bool, c_void_p, c_char_p, c_char_p, c_int64, POINTER(c_double)),
        ("time_nothing", None, c_size_t, times),
    ):
        getattr(loaded, name).restype, getattr(loaded, name).argtypes = result, arguments
    return loaded


class Buffer:
    def __init__(self, tf2, cache_ns):
        self.tf2 = tf2
        self.pointer = tf2.buffer_new(cache_ns)

    def __del__(self):
        self.tf2.buffer_free(self.pointer)

    def insert(self, transforms, budget_s):
        array, ns = (Transform * len(transforms))(*transforms), (c_int64 * len(transforms))()
        count = self.tf2.buffer_insert(self.pointer, array, len(array), budget_s, ns)
        return ns[:count]

    def look_up(self, queries, count, budget_s):
        array, ns = (Query * len(queries))(*queries), (c_int64 * count)()
        return ns[: self.tf2.buffer_look_up(self.pointer, array, len(array), count, budget_s, ns)]

    def answer(self, target, source, time_ns):
        pose = (c_double * 7)()
        return list(pose) if self.tf2.buffer_answer(self.pointer, target, source, time_ns, pose) else None


class Ros1Cpp(Contestant):
    def __init__(self, path):
        super().__init__()
        self.tf2 = library(path)

    def about(self):
        version = os.environ["BENCH_VERSION"]
        return {"version": version, "python": None, "returns": "geometry_msgs::TransformStamped (ROS 1)"}

    def load(self, tree):
        self.buffer = Buffer(self.tf2, tree.cache_ns)
        records = (
            (child.encode(), parent.encode(), static, stamp_ns, tuple(pose))
            for child, parent, static, stamp_ns, pose in tree.records()
        )
        while chunk := list(itertools.islice(records, CHUNK)):
            self.buffer.insert(chunk, UNLIMITED_S)

    def calls(self, way, queries):
        return self.buffer.answer, [(target.encode(), source.encode(), ns) for target, source, ns in queries]

    def numbers(self, answer):
        return answer

    def inserts(self, way, transforms):
        calls = [
            (child.encode(), parent.encode(), 0, ns, tuple(pose)) for child, parent, ns, pose in transforms
        ]
        return self.buffer.insert, calls, 1

    def time(self, function, calls, count, budget_s, must_answer=True):
        empty = (c_int64 * EMPTY)()
        self.tf2.time_nothing(EMPTY, empty)
        buffer = function.__self__
        if function == buffer.insert:
            tried = buffer.insert(calls, budget_s)
        else:
            tried = buffer.look_up(calls, count, budget_s)
        times = [ns for ns in tried if ns >= 0]
        return times, len(tried) - len(times), sorted(empty)[EMPTY // 2]


if __name__ == "__main__":
    serve(Ros1Cpp(sys.argv[1]))
