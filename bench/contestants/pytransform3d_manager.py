"""Owns the calls of pytransform3d's TemporalTransformManager, from PyPI."""

import importlib.metadata

import numpy as np
from pytransform3d.rotations import quaternion_from_matrix
from pytransform3d.transform_manager import (
    NumpyTimeseriesTransform,
    StaticTransform,
    TemporalTransformManager,
)
from pytransform3d.transformations import transform_from_pq
from serving import Contestant, by_pair, serve


def pq(pose):
    return [*pose[:3], pose[6], *pose[3:6]]


class Pytransform3d(Contestant):
    # A history is given whole, as arrays: there is no inserting. It interpolates along screws, so that its
    # translations between samples are not tf2's. Times are seconds from the tree's newest stamp, for float64
    # cannot hold the nanoseconds since 1970.

    def about(self):
        return {"version": importlib.metadata.version("pytransform3d"), "returns": "a 4x4 array"}

    def load(self, tree):
        self.buffer = TemporalTransformManager(check=False)
        history = {}
        for child, parent, static, stamp_ns, pose in tree.records():
            history.setdefault((child, parent, static), []).append((stamp_ns, pq(pose)))
        for (child, parent, static), samples in history.items():
            if static:
                transform = StaticTransform(transform_from_pq(samples[0][1]))
            else:
                stamps = [self.seconds(stamp_ns) for stamp_ns, _ in samples]
                transform = NumpyTimeseriesTransform(
                    np.array(stamps), np.array([pose for _, pose in samples])
                )
            self.buffer.add_transform(child, parent, transform)

    def seconds(self, ns):
        return (ns - self.tree.newest_ns) / 1e9 if ns else 0.0

    def calls(self, way, queries):
        if way == "vector":
            return self.buffer.get_transform_at_time, [
                (source, target, np.array([self.seconds(ns) for ns in times]))
                for target, source, times in by_pair(queries)
            ]
        return self.buffer.get_transform_at_time, [
            (source, target, self.seconds(ns)) for target, source, ns in queries
        ]

    def numbers(self, answer):
        matrix = answer if answer.ndim == 2 else answer[0]
        w, x, y, z = quaternion_from_matrix(matrix[:3, :3])
        return (*matrix[:3, 3], x, y, z, w)


if __name__ == "__main__":
    serve(Pytransform3d())
