"""Owns what SciPy's user writes for many times at once: Slerp and interp of each edge, then composing."""

import importlib.metadata

import numpy as np
from scipy.spatial.transform import Rotation, Slerp
from serving import Contestant, by_pair, serve


class Chain:
    """The edges of a chain of frames, from the first frame to the last."""

    def __init__(self, edges):
        self.edges = edges

    def at(self, times):
        translation, rotation = np.zeros((len(times), 3)), Rotation.identity()
        for stamps, slerp, positions in self.edges:
            step = np.stack([np.interp(times, stamps, positions[:, k]) for k in range(3)], axis=1)
            translation = translation + rotation.apply(step)
            rotation = rotation * slerp(times)
        return translation, rotation.as_quat()


class Scipy(Contestant):
    # Not a tree: whoever uses it knows the edges, and here they are a chain of dynamic frames, asked from its
    # first frame to its last.

    def about(self):
        return {"version": importlib.metadata.version("scipy"), "returns": "arrays"}

    def load(self, tree):
        history = {}
        for child, parent, _, stamp_ns, pose in tree.records():
            history.setdefault((parent, child), []).append((stamp_ns, *pose))
        self.history = {}
        for edge, samples in history.items():
            stamps = np.array([(sample[0] - tree.newest_ns) / 1e9 for sample in samples])
            poses = np.array([sample[1:] for sample in samples])
            self.history[edge] = stamps, Slerp(stamps, Rotation.from_quat(poses[:, 3:])), poses[:, :3]

    def calls(self, way, queries):
        ((target, source, times_ns),) = by_pair(queries)
        parents = {child: parent for parent, child in self.history}
        edges, frame = [], source
        while frame != target:
            edges.insert(0, self.history[parents[frame], frame])
            frame = parents[frame]
        times = np.array([(ns - self.tree.newest_ns) / 1e9 for ns in times_ns])
        return Chain(edges).at, [(times,)]

    def numbers(self, answer):
        return (*answer[0][0], *answer[1][0])


if __name__ == "__main__":
    serve(Scipy())
