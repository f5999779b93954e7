"""Owns the calls of transforms-py, from PyPI."""

import importlib.metadata

from serving import Contestant, serve
from transforms_py import PyRegistry


class Transforms(Contestant):
    # It knows no latest time: the newest common stamp is asked for instead. Stamp 0 makes an edge static.
    # What it cannot answer is None and a line on standard output.

    def about(self):
        return {"version": importlib.metadata.version("transforms-py"), "returns": "a tuple of 10"}

    def load(self, tree):
        self.buffer = PyRegistry()
        for child, parent, static, stamp_ns, pose in tree.records():
            self.buffer.add_transform(*pose, 0 if static else stamp_ns, parent, child)

    def calls(self, way, queries):
        newest_ns = self.tree.newest_ns
        return self.buffer.get_transform, [
            (target, source, ns or newest_ns) for target, source, ns in queries
        ]

    def numbers(self, answer):
        return answer[:7]

    def inserts(self, way, transforms):
        calls = [(*pose, stamp_ns, parent, child) for child, parent, stamp_ns, pose in transforms]
        return self.buffer.add_transform, calls, 1


if __name__ == "__main__":
    serve(Transforms())
