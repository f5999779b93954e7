"""Owns carrying points by the thousand: arrays of them, and whatever lies in memory like clouds do."""

from libc.stdint cimport uint32_t, uint64_t
from libc.string cimport memcpy

cimport numpy as cnp

from tf2_geometry_msgs._matrix cimport matrix_from_quaternion
from tf2_py._messages cimport read_transform
from tf2_py._types cimport Transform
from tf2_sensor_msgs._wide cimport wide_carry_doubles, wide_carry_floats

import numpy as np

cdef extern from *:
    uint32_t __builtin_bswap32(uint32_t bits) noexcept nogil
    uint64_t __builtin_bswap64(uint64_t bits) noexcept nogil

cnp.import_array()


cdef void rigid_from_transform(const Transform* transform, bint moves, Rigid* out) noexcept nogil:
    cdef int i
    matrix_from_quaternion(transform.rotation, out.matrix)
    for i in range(3):
        out.translation[i] = transform.translation[i] if moves else 0.0


cdef inline double _load(const char* place, Number number) noexcept nogil:
    # Copied byte by byte, because coordinates may lie at any address.
    cdef float single
    cdef double whole
    cdef uint32_t bits32
    cdef uint64_t bits64
    if number == FLOAT32:
        memcpy(&single, place, 4)
        return single
    if number == FLOAT64:
        memcpy(&whole, place, 8)
        return whole
    if number == FLOAT32_SWAPPED:
        memcpy(&bits32, place, 4)
        bits32 = __builtin_bswap32(bits32)
        memcpy(&single, &bits32, 4)
        return single
    memcpy(&bits64, place, 8)
    bits64 = __builtin_bswap64(bits64)
    memcpy(&whole, &bits64, 8)
    return whole


cdef inline void _store(char* place, Number number, double value) noexcept nogil:
    cdef float single = <float>value
    cdef uint32_t bits32
    cdef uint64_t bits64
    if number == FLOAT32:
        memcpy(place, &single, 4)
    elif number == FLOAT64:
        memcpy(place, &value, 8)
    elif number == FLOAT32_SWAPPED:
        memcpy(&bits32, &single, 4)
        bits32 = __builtin_bswap32(bits32)
        memcpy(place, &bits32, 4)
    else:
        memcpy(&bits64, &value, 8)
        bits64 = __builtin_bswap64(bits64)
        memcpy(place, &bits64, 8)


cdef inline void _carry_each(const char* source, const Triples* here, char* target, const Triples* there,
                             Py_ssize_t count, const Rigid* rigid, Number number) noexcept nogil:
    # Called with a constant `number`, so that the loop has no branches. And with copies of all it needs: a
    # store through a char* might change what a pointer leads to.
    cdef Triples a = here[0]
    cdef Triples b = there[0]
    cdef Rigid r = rigid[0]
    cdef double x, y, z
    cdef Py_ssize_t _
    for _ in range(count):
        x = _load(source + a.offsets[0], number)
        y = _load(source + a.offsets[1], number)
        z = _load(source + a.offsets[2], number)
        _store(target + b.offsets[0], number, _row(&r, 0, x, y, z))
        _store(target + b.offsets[1], number, _row(&r, 1, x, y, z))
        _store(target + b.offsets[2], number, _row(&r, 2, x, y, z))
        source += a.step
        target += b.step


cdef inline double _row(const Rigid* r, int row, double x, double y, double z) noexcept nogil:
    return r.matrix[3 * row] * x + r.matrix[3 * row + 1] * y + r.matrix[3 * row + 2] * z + r.translation[row]


cdef Py_ssize_t _wide_size(const Triples* triples) noexcept nogil:
    # Bytes of a number where x y z lie beside each other, in this order and this machine's; otherwise 0.
    cdef Py_ssize_t size = 4 if triples.number == FLOAT32 else 8 if triples.number == FLOAT64 else 0
    if (
        triples.offsets[1] == triples.offsets[0] + size
        and triples.offsets[2] == triples.offsets[1] + size
        and triples.step >= 3 * size
    ):
        return size
    return 0


cdef bint triples_fill_points(const Triples* triples) noexcept nogil:
    cdef Py_ssize_t size = _wide_size(triples)
    return triples.offsets[0] == 0 and size != 0 and triples.step in (3 * size, 4 * size)


cdef Py_ssize_t triples_carry_wide(const char* source, char* target, const Triples* triples,
                                   Py_ssize_t count, Py_ssize_t behind, const Rigid* rigid) noexcept nogil:
    cdef Py_ssize_t size = _wide_size(triples)
    if behind < size:
        count -= 1
    if count <= 0:
        return 0
    source += triples.offsets[0]
    target += triples.offsets[0]
    if size == 4:
        return wide_carry_floats(source, target, triples.step, count, rigid.matrix, rigid.translation)
    if size == 8:
        return wide_carry_doubles(source, target, triples.step, count, rigid.matrix, rigid.translation)
    return 0


cdef bint _lie_alike(const Triples* a, const Triples* b) noexcept nogil:
    cdef int i
    for i in range(3):
        if a.offsets[i] != b.offsets[i]:
            return False
    return a.step == b.step and a.number == b.number


cdef void triples_carry(const char* source, const Triples* here, char* target, const Triples* there,
                        Py_ssize_t count, Py_ssize_t behind, const Rigid* rigid) noexcept nogil:
    cdef Py_ssize_t done = 0
    if _lie_alike(here, there):
        done = triples_carry_wide(source, target, here, count, behind, rigid)
    source += done * here.step
    target += done * there.step
    count -= done
    if here.number == FLOAT32:
        _carry_each(source, here, target, there, count, rigid, FLOAT32)
    elif here.number == FLOAT64:
        _carry_each(source, here, target, there, count, rigid, FLOAT64)
    elif here.number == FLOAT32_SWAPPED:
        _carry_each(source, here, target, there, count, rigid, FLOAT32_SWAPPED)
    else:
        _carry_each(source, here, target, there, count, rigid, FLOAT64_SWAPPED)


def transform_points(point_cloud, transform):
    """Carry points into the frame of a transform: p' = R p + t, in double precision, without the GIL.

    :param point_cloud: an array of shape (n, 3), x y z in metres, of any strides; or what NumPy makes one of
    :param transform: a TransformStamped or Transform
    :returns: a new array of shape (n, 3): float32 for float32, otherwise float64
    :raises TypeError: for another transform, or points that are no real numbers
    :raises ValueError: for another shape, or a transform whose rotation is not finite
    """
    cdef Transform by
    cdef Rigid rigid
    cdef Triples here, there
    cdef cnp.ndarray points, carried
    cdef Py_ssize_t count, size
    cdef int i
    read_transform(transform, &by)
    rigid_from_transform(&by, True, &rigid)
    points = _real_points(point_cloud)
    count = cnp.PyArray_DIM(points, 0)
    carried = np.empty((count, 3), dtype=points.dtype)
    size = cnp.PyArray_ITEMSIZE(points)
    here.number = there.number = FLOAT32 if size == 4 else FLOAT64
    here.step = cnp.PyArray_STRIDE(points, 0)
    there.step = 3 * size
    for i in range(3):
        here.offsets[i] = i * cnp.PyArray_STRIDE(points, 1)
        there.offsets[i] = i * size
    with nogil:
        triples_carry(
            cnp.PyArray_BYTES(points), &here, cnp.PyArray_BYTES(carried), &there, count, 0, &rigid
        )
    return carried


cdef cnp.ndarray _real_points(object points):
    array = np.asarray(points)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"points must be real numbers, not {array.dtype}")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"points must have the shape (n, 3), not {array.shape}")
    single = array.dtype.kind == "f" and array.dtype.itemsize == 4
    # A copy only where the type or its byte order is another.
    return array.astype(np.float32 if single else np.float64, copy=False)
