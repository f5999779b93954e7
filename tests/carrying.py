"""Makes the messages that are transformed, and the arithmetic to judge the results by."""

import importlib
import math

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, Quaternion
from hypothesis import settings
from hypothesis import strategies as st
from making import transform
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header

# A busy machine is no reason to fail.
settings.register_profile("carrying", deadline=None)
settings.load_profile("carrying")

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


def xyz(m):
    return np.array([m.x, m.y, m.z])


def xyzw(m):
    return np.array([m.x, m.y, m.z, m.w])


def turn(q):
    """SciPy's rotation for a quaternion of any length, message or tuple."""
    q = np.array(q if isinstance(q, tuple) else xyzw(q))
    return Rotation.from_quat(q / np.linalg.norm(q))


def matrix(t):
    """The 4x4 matrix of a transform, by SciPy."""
    m = np.eye(4)
    m[:3, :3] = turn(t.transform.rotation).as_matrix()
    m[:3, 3] = xyz(t.transform.translation)
    return m


def transformed(points, t):
    """An (n, 3) array of points in the target frame of a transform."""
    return points @ matrix(t)[:3, :3].T + matrix(t)[:3, 3]


def inverse(t):
    back = turn(t.transform.rotation).inv()
    return transform(
        t.child_frame_id, t.header.frame_id, 7.25, -back.apply(xyz(t.transform.translation)), back.as_quat()
    )


def covariance_rotated(covariance, t):
    """A 6x6 covariance in the target frame of a transform, as one product of 6x6 matrices."""
    both = np.kron(np.eye(2), turn(t.transform.rotation).as_matrix())
    return both @ np.reshape(covariance, (6, 6)) @ both.T


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
            raise NotImplementedError(f"tests/carrying.py makes no {kind} yet: give Maker.value a line")
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
