"""Call ROS 1's tf2 for C++ as Debian packages it; the loops run in C++ (ros1_cpp.cpp)."""

import os
import sys
from ctypes import CDLL, POINTER, c_bool, c_char_p, c_double, c_int64, c_size_t, c_void_p

from serving import QUERY, RECORD, Contestant, serve

EMPTY = 1000
UNLIMITED_S = 1e6
TIMES = POINTER(c_int64)
FUNCTIONS = {
    "buffer_new": (c_void_p, c_int64, POINTER(c_char_p), c_size_t),
    "buffer_free": (None, c_void_p),
    "buffer_insert": (c_size_t, c_void_p, c_char_p, c_size_t, c_double, TIMES),
    "buffer_look_up": (c_size_t, c_void_p, c_char_p, c_size_t, c_size_t, c_double, TIMES),
    "buffer_answer": (c_bool, c_void_p, c_char_p, POINTER(c_double)),
    "time_nothing": (None, c_size_t, TIMES),
}


class Buffer:
    def __init__(self, tf2, tree):
        self.tf2 = tf2
        self.index = {name: i for i, name in enumerate(tree.names)}
        names = (c_char_p * len(tree.names))(*(name.encode() for name in tree.names))
        self.pointer = tf2.buffer_new(tree.cache_ns, names, len(names))

    def __del__(self):
        self.tf2.buffer_free(self.pointer)

    def insert(self, records, budget_s):
        """ns of each insert; below 0 where it is refused."""
        count = len(records) // RECORD.size
        ns = (c_int64 * count)()
        return ns[: self.tf2.buffer_insert(self.pointer, records, count, budget_s, ns)]

    def look_up(self, queries, count, budget_s):
        """ns of each lookup; below 0 where there is no answer."""
        packed = b"".join(map(self.query, queries))
        ns = (c_int64 * count)()
        return ns[: self.tf2.buffer_look_up(self.pointer, packed, len(queries), count, budget_s, ns)]

    def answer(self, *query):
        pose = (c_double * 7)()
        return list(pose) if self.tf2.buffer_answer(self.pointer, self.query(query), pose) else None

    def query(self, query):
        target, source, time_ns = query
        return QUERY.pack(self.index[target], self.index[source], time_ns)


class Ros1Cpp(Contestant):
    def __init__(self, path):
        super().__init__()
        self.tf2 = CDLL(path)
        for name, (result, *arguments) in FUNCTIONS.items():
            function = getattr(self.tf2, name)
            function.restype, function.argtypes = result, arguments

    def about(self):
        version = os.environ["BENCH_VERSION"]
        return {"version": version, "python": None, "returns": "geometry_msgs::TransformStamped (ROS 1)"}

    def load(self, tree):
        self.buffer = Buffer(self.tf2, tree)
        for records in tree.chunks():
            self.buffer.insert(records, UNLIMITED_S)

    def calls(self, way, queries):
        return self.buffer.answer, queries

    def numbers(self, answer):
        return answer

    def inserts(self, way, transforms):
        index = self.buffer.index
        return (
            self.buffer.insert,
            [
                RECORD.pack(index[child], index[parent], 0, 0, ns, *pose)
                for child, parent, ns, pose in transforms
            ],
            1,
        )

    def time(self, function, calls, count, budget_s, must_answer=True):
        empty = (c_int64 * EMPTY)()
        self.tf2.time_nothing(EMPTY, empty)
        buffer = function.__self__
        if function == buffer.insert:
            tried = buffer.insert(b"".join(calls), budget_s)
        else:
            tried = buffer.look_up(calls, count, budget_s)
        times = [ns for ns in tried if ns >= 0]
        return times, len(tried) - len(times), sorted(empty)[EMPTY // 2]


if __name__ == "__main__":
    serve(Ros1Cpp(sys.argv[1]))
