"""Owns the engine's quaternion maths for arrays of Python's."""

from tf2_py._core.geometry cimport quaternion_normalise_any


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
