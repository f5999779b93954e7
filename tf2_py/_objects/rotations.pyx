"""Owns the engine's quaternion maths for arrays of Python's."""

from tf2_py._core.geometry cimport matrix_from_quaternion, quaternion_normalise_any

from tf2_py._objects.arrays import new_rows


def normalise(double[:, ::1] rotations not None):
    """
    Give each row, a quaternion x y z w, the length one, in place.

    :return: the index of the first row without a finite length above zero, which ends the work; -1: none.
    """
    cdef Py_ssize_t row
    if rotations.shape[1] != 4:
        raise ValueError(f"a quaternion has 4 numbers, not {rotations.shape[1]}")
    for row in range(rotations.shape[0]):
        if not quaternion_normalise_any(&rotations[row, 0]):
            return row
    return -1


def rotation_matrices(const double[:, ::1] rotations not None):
    """
    Make a matrix of each row.

    :param rotations: N rows: unit quaternions x y z w.
    :return: float64, shape (N, 3, 3).
    """
    cdef Py_ssize_t row
    cdef Py_ssize_t count = rotations.shape[0]
    if rotations.shape[1] != 4:
        raise ValueError(f"a quaternion has 4 numbers, not {rotations.shape[1]}")
    matrices = new_rows(count, 9)
    cdef double[:, ::1] rows = matrices
    for row in range(count):
        matrix_from_quaternion(&rotations[row, 0], &rows[row, 0])
    return matrices.reshape(count, 3, 3)
