# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a transform makes of points, rotations, covariances and every type of message, by the textbook."""

import numpy as np
from rotations import Turn


def xyz(m):
    return np.array([m.x, m.y, m.z])


def xyzw(m):
    return np.array([m.x, m.y, m.z, m.w])


def turn(q):
    """The rotation of a quaternion of any length, message or tuple."""
    return Turn(q if isinstance(q, tuple) else xyzw(q))


def matrix(t):
    """The 4x4 matrix of a transform."""
    m = np.eye(4)
    m[:3, :3] = turn(t.transform.rotation).as_matrix()
    m[:3, 3] = xyz(t.transform.translation)
    return m


def transformed(points, t):
    """An (n, 3) array of points in the target frame of a transform."""
    return points @ matrix(t)[:3, :3].T + matrix(t)[:3, 3]


def covariance_rotated(covariance, r):
    """A 3x3 or 6x6 covariance after a rotation, as one product of matrices."""
    turns = np.kron(np.eye(np.size(covariance) // 9 // 2 or 1), r.as_matrix())
    return turns @ np.reshape(covariance, turns.shape) @ turns.T


def _of_point(m, r, moved):
    return r.apply(xyz(m)) + moved


def _of_vector(m, r, moved):
    return r.apply(xyz(m))


def _of_transform(m, r, moved):
    return [*(r.apply(xyz(m.translation)) + moved), *(r * turn(m.rotation)).canonical()]


def _of_wrench(m, r, moved):
    # The same force; its torque about the new origin.
    force = r.apply(xyz(m.force))
    return [*force, *(r.apply(xyz(m.torque)) + np.cross(moved, force))]


def _of_velocity(m, r, moved):
    # The same motion of a rigid body; the velocity of its point at the new origin.
    angular = r.apply(xyz(m.velocity.angular))
    return [*(r.apply(xyz(m.velocity.linear)) + np.cross(moved, angular)), *angular]


def _of_odometry(m, r, moved):
    twist = m.twist.twist  # is in the child frame
    return [*numbers_in(m.pose, r, moved), *xyz(twist.linear), *xyz(twist.angular), *m.twist.covariance]


def _of_imu(m, r, moved):
    # The attitude is that of the new frame in the world.
    parts = [(turn(m.orientation) * r.inverse()).canonical(), m.orientation_covariance]
    for name in ("angular_velocity", "linear_acceleration"):
        parts += [r.apply(xyz(getattr(m, name))), numbers_in(getattr(m, f"{name}_covariance"), r, moved)]
    return np.concatenate(parts)


RULES = {
    "Point": _of_point,
    "Point32": _of_point,
    "Vector3": _of_vector,
    "Quaternion": lambda m, r, moved: (r * turn(m)).canonical(),
    "Transform": _of_transform,
    "Wrench": _of_wrench,
    "VelocityStamped": _of_velocity,
    "Odometry": _of_odometry,
    "Imu": _of_imu,
    "Header": lambda m, r, moved: [],
    "str": lambda m, r, moved: [],
}


def numbers_in(m, r, moved):
    """
    Every number of a message in another frame, in the order of `random_messages.numbers`.

    A class without a rule becomes what its fields become; an array is a covariance of x y z, or of two.
    """
    rule = RULES.get(type(m).__name__)
    if rule is not None:
        return list(rule(m, r, moved))
    if isinstance(m, int | float):
        return [m]
    if isinstance(m, np.ndarray):
        return list(covariance_rotated(m, r).ravel())
    parts = m if isinstance(m, list) else [getattr(m, field) for field in m.get_fields_and_field_types()]
    return [number for part in parts for number in numbers_in(part, r, moved)]
