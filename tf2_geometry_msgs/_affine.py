# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The NumPy helpers that programs take from tf2's module: matrices and quaternions w x y z."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tf2_py._internal import matrices_from_rotations, normalize

Matrix = NDArray[Any]


def _get_mat_from_quat(quaternion: NDArray[Any]) -> Matrix:
    """
    The rotation matrix of a quaternion.

    :param quaternion: w, x, y, z, of any length; zero length means no rotation.
    """
    if np.dot(quaternion, quaternion) < np.finfo(np.float64).eps:
        return np.eye(3)
    w, x, y, z = quaternion
    rotations = np.array([[x, y, z, w]], dtype=np.float64)
    normalize(rotations)  # not if NaN or infinite, as the matrix is then
    matrix: Matrix = matrices_from_rotations(rotations)[0]
    return matrix


def _get_quat_from_mat(rot_mat: NDArray[Any]) -> NDArray[Any]:
    """
    The quaternion w, x, y, z of a rotation matrix, of length one and with w >= 0.

    Of a matrix that is not quite one, the quaternion nearest to it: I. Y. Bar-Itzhack, New method for
    extracting the quaternion from a rotation matrix, Journal of Guidance, Control, and Dynamics 23(6), 2000.
    """
    trace = np.trace(rot_mat)
    form = np.empty((4, 4))
    form[:3, :3] = rot_mat + rot_mat.T - trace * np.eye(3)
    form[3, :3] = form[:3, 3] = (
        rot_mat[2, 1] - rot_mat[1, 2],
        rot_mat[0, 2] - rot_mat[2, 0],
        rot_mat[1, 0] - rot_mat[0, 1],
    )
    form[3, 3] = trace
    # The eigenvalues come in ascending order.
    x, y, z, w = np.linalg.eigh(form / 3.0)[1][:, -1]
    quaternion = np.array([w, x, y, z])
    return -quaternion if w < 0 else quaternion


def _build_affine(
    rotation: Iterable[float] | None = None, translation: Iterable[float] | None = None
) -> Matrix:
    """
    The 4x4 matrix of a rotation followed by a translation.

    :param rotation: w, x, y, z.
    :param translation: x, y, z.
    """
    affine = np.eye(4)
    if rotation is not None:
        affine[:3, :3] = _get_mat_from_quat(np.asarray(rotation))
    if translation is not None:
        affine[:3, 3] = np.asarray(translation)
    return affine


def _transform_to_affine(transform: Any) -> Matrix:
    """The 4x4 matrix of a TransformStamped."""
    r, t = transform.transform.rotation, transform.transform.translation
    return _build_affine((r.w, r.x, r.y, r.z), (t.x, t.y, t.z))


def _decompose_affine(affine: Matrix) -> tuple[NDArray[Any], NDArray[Any]]:
    """The quaternion w, x, y, z and the translation of a 4x4 matrix."""
    return _get_quat_from_mat(affine[:3, :3]), affine[:3, 3]
