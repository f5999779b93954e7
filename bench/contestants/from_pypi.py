"""Owns the calls of the libraries from PyPI; `python from_pypi.py NAME` serves one of them."""

import importlib
import importlib.metadata
import sys

import numpy as np
from recorded import messages_by_rosbags, records_of
from serving import Contestant, by_pair, serve

BATCH = 1000


class FromPypi(Contestant):
    """`modules` are imported when the library is served: the others may not be installed."""

    package = returns = ""
    modules = ()

    def __init__(self):
        super().__init__()
        self.imported = [importlib.import_module(name) for name in self.modules]

    def about(self):
        return {"version": importlib.metadata.version(self.package), "returns": self.returns}

    def seconds(self, ns):
        """From the newest stamp: float64 cannot hold the nanoseconds since 1970. 0 (latest) stays 0."""
        return (ns - self.tree.newest_ns) / 1e9 if ns else 0.0


class Schiebung(FromPypi):
    # Its history is 120 s for any cache time; a latest lookup takes each edge's own newest sample.
    package, returns, modules = "schiebung", "StampedIsometry, an object of its own", ("schiebung",)

    def load(self, tree):
        self.load_records(tree.records())

    def load_recording(self, path):
        self.load_records(records_of(messages_by_rosbags(path)))

    def load_records(self, records):
        self.buffer = self.imported[0].BufferTree()
        batch = []
        for record in records:
            batch.append(self.update(*record))
            if len(batch) == BATCH:
                self.buffer.update_batch(batch)
                batch = []
        self.buffer.update_batch(batch)

    def update(self, child, parent, static, stamp_ns, pose):
        (schiebung,) = self.imported
        kind = schiebung.TransformType.Static if static else schiebung.TransformType.Dynamic
        return parent, child, schiebung.StampedIsometry(list(pose[:3]), list(pose[3:]), stamp_ns), kind

    def calls(self, way, queries):
        if all(ns == 0 for _, _, ns in queries):
            return self.buffer.lookup_latest_transform, [(target, source) for target, source, _ in queries]
        return self.buffer.lookup_transform, queries

    def numbers(self, answer):
        return (*answer.translation(), *answer.rotation())

    def inserts(self, way, transforms):
        calls = [self.update(child, parent, False, ns, pose) for child, parent, ns, pose in transforms]
        return self.buffer.update, calls, 1


class Transforms(FromPypi):
    # It has no latest time: the newest common stamp is requested instead. Stamp 0 makes an edge static.
    # Where it has no answer, it returns None and prints a line.
    package, returns, modules = "transforms-py", "a tuple of 10", ("transforms_py",)

    def load(self, tree):
        self.buffer = self.imported[0].PyRegistry()
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


class Pytransform3d(FromPypi):
    # A history is given whole, as arrays: there is no inserting. It interpolates along screws, so that its
    # translations between samples are not tf2's.
    package, returns = "pytransform3d", "a 4x4 array"
    modules = "pytransform3d.rotations", "pytransform3d.transformations", "pytransform3d.transform_manager"

    def load(self, tree):
        _, transformations, manager = self.imported
        self.buffer = manager.TemporalTransformManager(check=False)
        history = {}
        for child, parent, static, stamp_ns, pose in tree.records():
            pq = [*pose[:3], pose[6], *pose[3:6]]
            history.setdefault((child, parent, static), []).append((self.seconds(stamp_ns), pq))
        for (child, parent, static), samples in history.items():
            if static:
                transform = manager.StaticTransform(transformations.transform_from_pq(samples[0][1]))
            else:
                transform = manager.NumpyTimeseriesTransform(
                    np.array([stamp for stamp, _ in samples]), np.array([pq for _, pq in samples])
                )
            self.buffer.add_transform(child, parent, transform)

    def calls(self, way, queries):
        look_up = self.buffer.get_transform_at_time
        if way == "vector":
            return look_up, [
                (source, target, np.array([self.seconds(ns) for ns in times]))
                for target, source, times in by_pair(queries)
            ]
        return look_up, [(source, target, self.seconds(ns)) for target, source, ns in queries]

    def numbers(self, answer):
        matrix = answer if answer.ndim == 2 else answer[0]
        w, x, y, z = self.imported[0].quaternion_from_matrix(matrix[:3, :3])
        return (*matrix[:3, 3], x, y, z, w)


class Scipy(FromPypi):
    """What SciPy's user writes for many times at once: Slerp and interp of each edge, then composing."""

    # SciPy has no tree: the user knows the edges. Here they are a chain of dynamic frames, looked up from its
    # first frame to its last.
    package, returns, modules = "scipy", "arrays", ("scipy.spatial.transform",)

    def load(self, tree):
        (transform,) = self.imported
        history = {}
        for child, parent, _, stamp_ns, pose in tree.records():
            history.setdefault((parent, child), []).append((self.seconds(stamp_ns), *pose))
        self.edges = {}
        for edge, samples in history.items():
            table = np.array(samples)
            stamps, rotations = table[:, 0], transform.Rotation.from_quat(table[:, 4:])
            self.edges[edge] = stamps, transform.Slerp(stamps, rotations), table[:, 1:4]

    def calls(self, way, queries):
        ((target, source, times_ns),) = by_pair(queries)
        parents = {child: parent for parent, child in self.edges}
        path, frame = [], source
        while frame != target:
            path.insert(0, self.edges[parents[frame], frame])
            frame = parents[frame]
        return self.compose, [(path, np.array([self.seconds(ns) for ns in times_ns]))]

    def compose(self, path, times):
        translation, rotation = np.zeros((len(times), 3)), self.imported[0].Rotation.identity()
        for stamps, slerp, positions in path:
            step = np.stack([np.interp(times, stamps, positions[:, k]) for k in range(3)], axis=1)
            translation = translation + rotation.apply(step)
            rotation = rotation * slerp(times)
        return translation, rotation.as_quat()

    def numbers(self, answer):
        return (*answer[0][0], *answer[1][0])


if __name__ == "__main__":
    serve({library.package: library for library in FromPypi.__subclasses__()}[sys.argv[1]]())
