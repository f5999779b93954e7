"""Owns the calls of schiebung, from PyPI."""

import importlib.metadata

from schiebung import BufferTree, StampedIsometry, TransformType
from serving import Contestant, serve

BATCH = 1000


def update(child, parent, static, stamp_ns, pose):
    kind = TransformType.Static if static else TransformType.Dynamic
    return parent, child, StampedIsometry(list(pose[:3]), list(pose[3:]), stamp_ns), kind


class Schiebung(Contestant):
    # Its history is 120 s, whatever the tree says; a latest lookup takes each edge's own newest sample.

    def about(self):
        return {
            "version": importlib.metadata.version("schiebung"),
            "returns": "StampedIsometry, an object of its own",
        }

    def load(self, tree):
        self.buffer = BufferTree()
        batch = []
        for record in tree.records():
            batch.append(update(*record))
            if len(batch) == BATCH:
                self.buffer.update_batch(batch)
                batch = []
        self.buffer.update_batch(batch)

    def calls(self, way, queries):
        if all(ns == 0 for _, _, ns in queries):
            return self.buffer.lookup_latest_transform, [(target, source) for target, source, _ in queries]
        return self.buffer.lookup_transform, queries

    def numbers(self, answer):
        return (*answer.translation(), *answer.rotation())

    def inserts(self, way, transforms):
        calls = [update(child, parent, False, stamp_ns, pose) for child, parent, stamp_ns, pose in transforms]
        return self.buffer.update, calls, 1


if __name__ == "__main__":
    serve(Schiebung())
