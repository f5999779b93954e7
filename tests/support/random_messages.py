# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Makes random messages and transforms for the tests of transforming."""

import importlib
import math

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, Quaternion
from hypothesis import strategies as st
from std_msgs.msg import Header
from times_and_transforms import transform

coordinates = st.floats(-1e6, 1e6) | st.sampled_from([0.0, -0.0, 1e-300, -5e-324, 1.0, 0.1])
vectors = st.tuples(coordinates, coordinates, coordinates)

HALF = math.sqrt(0.5)
AWKWARD_TURNS = [
    (0.0, 0.0, 0.0, 1.0),
    (0.0, 0.0, 0.0, -1.0),
    (1.0, 0.0, 0.0, 0.0),  # half turns: w is zero
    (0.0, -1.0, 0.0, 0.0),
    (0.0, 0.0, 1.0, -0.0),
    (HALF, HALF, 0.0, 1e-17),
    (0.0, 0.0, HALF, HALF),
    (-0.5, -0.5, -0.5, -0.5),
    (1e-9, 0.0, 0.0, 1.0),
]
_parts_of_turns = st.floats(-1.0, 1.0)
_any_turn = st.tuples(_parts_of_turns, _parts_of_turns, _parts_of_turns, _parts_of_turns).filter(
    lambda q: math.hypot(*q) > 1e-3
)
_lengths = st.sampled_from([1.0, 2.0, 1e-3])
# Quaternions x y z w that stand for rotations, not all of length one.
turns = st.sampled_from(AWKWARD_TURNS) | st.builds(
    lambda q, length: tuple(length * x for x in q), _any_turn, _lengths
)
transforms = st.builds(lambda xyz, xyzw: transform("map", "base", 7.25, xyz, xyzw), vectors, turns)


class Maker:
    """Makes random messages of any class; quaternions have length one and w >= 0, so that they compare."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)

    def header(self):
        return Header(frame_id="base", stamp=Time(sec=int(self.random.integers(100, 200))))

    def quaternion(self):
        q = self.random.normal(size=4)
        q *= np.sign(q[3]) / np.linalg.norm(q)
        return Quaternion(**dict(zip("xyzw", q.tolist(), strict=True)))

    def covariance(self, side=6):
        half = self.random.normal(size=(side, side))
        return (half @ half.T).ravel()

    def pose(self):
        return self.message(Pose)

    def message(self, cls):
        """A message whose texts are the names of their fields."""
        if cls is Quaternion:
            return self.quaternion()
        kinds = cls.get_fields_and_field_types()
        return cls(**{name: self.value(name, kind) for name, kind in kinds.items()})

    def value(self, name, kind):
        """A value of a type that is written as in `get_fields_and_field_types`."""
        made = {
            "double": lambda: self.random.uniform(-10, 10),
            "float": lambda: self.random.uniform(-10, 10),
            "int64": lambda: int(self.random.integers(100)),
            "string": lambda: name,
            "double[9]": lambda: self.covariance(3),
            "double[36]": lambda: self.covariance(6),
            "std_msgs/Header": self.header,
        }
        if kind in made:
            return made[kind]()
        if kind.startswith("sequence<"):
            return [self.value(name, kind[len("sequence<") : -1]) for _ in range(5)]
        if "/" not in kind:
            raise NotImplementedError(
                f"tests/support/random_messages.py makes no {kind} yet: give Maker.value a line"
            )
        package, _, cls = kind.partition("/")
        return self.message(getattr(importlib.import_module(f"{package}.msg"), cls))


def numbers(m):
    """Every number in a message outside its headers, in order."""
    if isinstance(m, Header | str):
        return []
    if isinstance(m, int | float):
        return [m]
    parts = m if isinstance(m, list | np.ndarray) else [getattr(m, f) for f in m.get_fields_and_field_types()]
    return [number for part in parts for number in numbers(part)]
