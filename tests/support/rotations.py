# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rotations by the textbook, as unit quaternions x y z w; arrays of many broadcast."""

import numpy as np


class Turn:
    """One rotation, or many along the first axis."""

    def __init__(self, q):
        """:param q: quaternions x y z w of any length, an array of shape (..., 4)."""
        q = np.asarray(q, float)
        self.q = q / np.linalg.norm(q, axis=-1, keepdims=True)

    @classmethod
    def from_vector(cls, vector):
        """About the direction of a vector, by its length in radians."""
        vector = np.asarray(vector, float)
        angle = np.linalg.norm(vector, axis=-1, keepdims=True)
        # sinc is of pi times its argument, and 1 at zero.
        return cls(np.concatenate([vector * np.sinc(angle / 2 / np.pi) / 2, np.cos(angle / 2)], axis=-1))

    @classmethod
    def from_angles(cls, roll, pitch, yaw):
        """About the fixed axes x, y and z, in this order, in radians."""
        x, y, z = (cls.from_vector(v) for v in np.diag([roll, pitch, yaw]))
        return z * y * x

    @classmethod
    def random(cls, random, count):
        """Uniformly distributed ones of a generator of NumPy."""
        return cls(random.normal(size=(count, 4)))

    def apply(self, points):
        v, w = self.q[..., :3], self.q[..., 3:]
        across = 2 * np.cross(v, points)
        return points + w * across + np.cross(v, across)

    def as_matrix(self):
        return np.stack([self.apply(axis) for axis in np.eye(3)], axis=-1)

    def angle(self):
        """In radians, exact near zero, too."""
        return 2 * np.arctan2(np.linalg.norm(self.q[..., :3], axis=-1), np.abs(self.q[..., 3]))

    def canonical(self):
        """Of q and -q, the one whose w is not negative."""
        return np.where(self.q[..., 3:] < 0, -self.q, self.q)

    def inverse(self):
        return Turn(self.q * (-1, -1, -1, 1))

    def __mul__(self, other):
        """The other one first, then this one."""
        (u, a), (v, b) = ((one.q[..., :3], one.q[..., 3:]) for one in (self, other))
        w = a * b - (u * v).sum(axis=-1, keepdims=True)
        return Turn(np.concatenate([a * v + b * u + np.cross(u, v), w], axis=-1))
