# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""transform-tree, a library for Python that is written in Rust and needs no ROS."""

import numpy as np
from measured_library import MeasuredLibrary, by_pair


class TfTree(MeasuredLibrary):
    # Its plans are compiled before they are timed, as its users are meant to; "names" compiles none.
    ways, vector_ways = ("plan", "names"), ("vector",)

    def __init__(self):
        import tf_tree

        self.module = tf_tree

    def load(self, tree):
        tf_tree = self.module
        static = {child: pose for child, _, is_static, _, pose in tree.transforms() if is_static}
        lines = ["[topology]", 'interp = "lerpslerp"']  # as tf2 does
        for child, parent in tree.links:
            name = tree.names[child]
            pose = static.get(name)
            kind = "dynamic" if pose is None else "static"
            size = f"capacity = {tree.samples}" if pose is None else f"pose = {_real_first(pose)}"
            edge = f'parent = "{tree.names[parent]}"\nchild = "{name}"\nkind = "{kind}"\n{size}'
            lines += ["[[edge]]", edge]
        self.tree = tf_tree.build("\n".join(lines))
        records = tree.records[tree.records["static"] == 0]
        self.publishers = {}
        for child in np.unique(records["child"]):
            own = records[records["child"] == child]
            name = tree.names[child]
            self.publishers[name] = self.tree.publisher(name, tree.names[own["parent"][0]])
            poses = own["pose"][:, [6, 3, 4, 5, 0, 1, 2]]
            self.publishers[name].push_many(own["stamp_ns"].copy(), np.ascontiguousarray(poses))

    def calls(self, way, queries):
        if way == "vector":
            plans = [(self.tree.plan(target, source), times) for target, source, times in by_pair(queries)]
            return self.module.Plan.at, plans
        if way == "names":
            return self.tree.lookup, queries
        plans = {pair: self.tree.plan(*pair) for pair in {(target, source) for target, source, _ in queries}}
        if all(ns == 0 for _, _, ns in queries):
            return self.module.Plan.latest, [(plans[target, source],) for target, source, _ in queries]
        return self.module.Plan.at, [(plans[target, source], ns) for target, source, ns in queries]

    def inserts(self, way, transforms):
        calls = [(self.publishers[child], ns, _real_first(pose)) for child, _, ns, pose in transforms]
        return self.module.Publisher.push, calls, 1


def _real_first(pose):
    return [pose[6], *pose[3:6], *pose[:3]]
