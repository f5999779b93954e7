"""Computes, with SciPy, what a transform makes of points, rotations and covariances."""

import numpy as np
from making import transform
from scipy.spatial.transform import Rotation


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
