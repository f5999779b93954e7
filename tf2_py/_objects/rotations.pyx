"""Owns the engine's quaternion maths for arrays of Python's."""

from libc.math cimport isnan

from tf2_py._core.geometry cimport (
    matrix_defect,
    matrix_determinant,
    matrix_from_quaternion,
    quaternion_from_matrix,
    quaternion_normalise_any,
)

from tf2_py._objects.arrays import new_rows


def normalise(double[:, ::1] rotations not None, *, bint nan_missing=False):
    """
    Give each row, a quaternion x y z w, the length one, in place.

    :param nan_missing: rows that are NaN throughout stay so.
    :return: the index of the first row without a finite length above zero, which ends the work; -1: none.
    """
    cdef Py_ssize_t row
    _check_width(rotations.shape[1], 4)
    for row in range(rotations.shape[0]):
        if not quaternion_normalise_any(&rotations[row, 0]):
            if not (nan_missing and _is_nan(&rotations[row, 0], 4)):
                return row
    return -1


def matrices_from_rotations(const double[:, ::1] rotations not None):
    """
    Make a matrix of each row.

    :param rotations: N rows: unit quaternions x y z w, or NaN.
    :return: float64, shape (N, 3, 3).
    """
    cdef Py_ssize_t row
    cdef Py_ssize_t count = rotations.shape[0]
    _check_width(rotations.shape[1], 4)
    matrices = new_rows(count, 9)
    cdef double[:, ::1] rows = matrices
    for row in range(count):
        matrix_from_quaternion(&rotations[row, 0], &rows[row, 0])
    return matrices.reshape(count, 3, 3)


def rotations_from_matrices(const double[:, ::1] matrices not None, double tolerance):
    """
    Read the quaternion of each row out of a matrix.

    :param matrices: N rows of the 9 numbers of a matrix, row by row; NaN throughout, or finite.
    :param tolerance: by how much a part of R R^T may differ.
    :return: quaternions x y z w of length one with w >= 0, or NaN, float64, shape (N, 4); the index of the
        first row that is no rotation, which ends the work, or -1; and by how much that row differs from an
        orthogonal matrix: it is a reflection if this is within the tolerance.
    """
    cdef Py_ssize_t row
    cdef Py_ssize_t count = matrices.shape[0]
    cdef double defect
    _check_width(matrices.shape[1], 9)
    rotations = new_rows(count, 4)
    cdef double[:, ::1] rows = rotations
    for row in range(count):
        if isnan(matrices[row, 0]):
            rows[row, 0] = rows[row, 1] = rows[row, 2] = rows[row, 3] = matrices[row, 0]
            continue
        defect = matrix_defect(&matrices[row, 0])
        if defect > tolerance or matrix_determinant(&matrices[row, 0]) < 0.0:
            return rotations, row, defect
        quaternion_from_matrix(&matrices[row, 0], &rows[row, 0])
    return rotations, -1, 0.0


cdef int _check_width(Py_ssize_t width, Py_ssize_t wanted) except -1:
    if width != wanted:
        raise ValueError(f"each row must have {wanted} numbers, not {width}")
    return 0


cdef bint _is_nan(const double* numbers, int count) noexcept nogil:
    cdef int i
    for i in range(count):
        if not isnan(numbers[i]):
            return False
    return True
