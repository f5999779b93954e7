# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transform coordinates in any arrangement in memory; a part of _cloud.pyx."""

cdef struct Rigid:
    double matrix[9]        # row by row
    double translation[3]   # meters; zero for directions


cdef struct Triples:
    # Where x, y and z of each point lie; any alignment.
    Py_ssize_t offsets[3]   # bytes from the start of a point
    Py_ssize_t step         # bytes from one point's start to the next one's
    int numbers[3]          # their types, see Number


cdef enum:
    OTHER_FLOAT32 = FLOAT32 | OTHER_ORDER
    OTHER_FLOAT64 = FLOAT64 | OTHER_ORDER


# For a rotation of any length, in the order in which tf2 computes it with NumPy, so that truncated integers
# are the same. With `moves` False the translation is zero.
cdef void rigid_from_transform(const Transform* transform, bint moves, Rigid* out) noexcept nogil:
    cdef const double* q = transform.rotation
    cdef double squared = q[3] * q[3] + q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
    cdef double x = q[0] * 2.0 / squared
    cdef double y = q[1] * 2.0 / squared
    cdef double z = q[2] * 2.0 / squared
    cdef int i
    out.matrix[0] = 1.0 - (y * q[1] + z * q[2])
    out.matrix[1] = y * q[0] - z * q[3]
    out.matrix[2] = z * q[0] + y * q[3]
    out.matrix[3] = y * q[0] + z * q[3]
    out.matrix[4] = 1.0 - (x * q[0] + z * q[2])
    out.matrix[5] = z * q[1] - x * q[3]
    out.matrix[6] = z * q[0] - y * q[3]
    out.matrix[7] = z * q[1] + x * q[3]
    out.matrix[8] = 1.0 - (x * q[0] + y * q[1])
    for i in range(3):
        out.translation[i] = transform.translation[i] if moves else 0.0


cdef inline void _transform_each(const char* source, const Triples* source_at, char* target,
                                 const Triples* target_at, Py_ssize_t count, const Rigid* rigid, int number_x,
                                 int number_y, int number_z) noexcept nogil:
    # Called with constant numbers for the common types, so that the loop has no branches. It works on copies,
    # because a store through a char* might change what a pointer leads to.
    cdef Triples a = source_at[0]
    cdef Triples b = target_at[0]
    cdef Rigid r = rigid[0]
    cdef double x, y, z
    cdef Py_ssize_t _
    for _ in range(count):
        x = number_load(source + a.offsets[0], number_x)
        y = number_load(source + a.offsets[1], number_y)
        z = number_load(source + a.offsets[2], number_z)
        number_store(target + b.offsets[0], number_x, _row(&r, 0, x, y, z))
        number_store(target + b.offsets[1], number_y, _row(&r, 1, x, y, z))
        number_store(target + b.offsets[2], number_z, _row(&r, 2, x, y, z))
        source += a.step
        target += b.step


cdef inline double _row(const Rigid* r, int row, double x, double y, double z) noexcept nogil:
    return r.matrix[3 * row] * x + r.matrix[3 * row + 1] * y + r.matrix[3 * row + 2] * z + r.translation[row]


cdef int _common_number(const Triples* triples) noexcept nogil:
    # The type of all three coordinates, or 0.
    cdef int number = triples.numbers[0]
    return number if triples.numbers[1] == number and triples.numbers[2] == number else 0


cdef Py_ssize_t _wide_size(const Triples* triples) noexcept nogil:
    # The bytes of a number if x y z lie beside each other, in this order and this machine's byte order, and
    # the machine can do several at once; otherwise 0.
    cdef int number = _common_number(triples)
    cdef Py_ssize_t size = number_size(number) if number in (FLOAT32, FLOAT64) else 0
    if (
        triples.offsets[1] == triples.offsets[0] + size
        and triples.offsets[2] == triples.offsets[1] + size
        and triples.step >= 3 * size
        and avx2_is_supported()
    ):
        return size
    return 0


cdef bint triples_fill_points(const Triples* triples, Py_ssize_t source_step) noexcept nogil:
    cdef Py_ssize_t size = _wide_size(triples)
    if triples.offsets[0] != 0 or size == 0:
        return False
    return triples.step == 3 * size or (triples.step == 4 * size and source_step == triples.step)


# Transforms as many points, from the first on, as can be done quickly, and returns their number. `triples`
# describes the target, and also the source, except that the step of the source may differ if
# triples_fill_points. In that case all bytes of the target's points are written, so `target` need not be a
# copy of `source`.
cdef Py_ssize_t triples_transform_wide(const char* source, Py_ssize_t source_step, char* target,
                                       const Triples* triples, Py_ssize_t count, Py_ssize_t bytes_after,
                                       const Rigid* rigid) noexcept nogil:
    cdef Py_ssize_t size = _wide_size(triples)
    cdef Py_ssize_t step = triples.step
    if bytes_after < size:
        count -= 1
    if count <= 0:
        return 0
    source += triples.offsets[0]
    target += triples.offsets[0]
    if size == 4:
        return avx2_floats(source, source_step, target, step, count, rigid.matrix, rigid.translation)
    if size == 8:
        return avx2_doubles(source, source_step, target, step, count, rigid.matrix, rigid.translation)
    return 0


cdef bint _same_arrangement(const Triples* a, const Triples* b) noexcept nogil:
    cdef int i
    for i in range(3):
        if a.offsets[i] != b.offsets[i]:
            return False
        if a.numbers[i] != b.numbers[i]:
            return False
    return a.step == b.step


# Computes p' = R p + t for `count` points, in double precision. `source` and `target` may be the same if
# their arrangements are equal. `bytes_after` is how many bytes behind the last coordinate of the last point
# may be read from `source` and written to `target`, unchanged, as may the bytes between points.
cdef void triples_transform(const char* source, const Triples* source_at, char* target,
                            const Triples* target_at, Py_ssize_t count, Py_ssize_t bytes_after,
                            const Rigid* rigid) noexcept nogil:
    cdef Py_ssize_t done = 0
    cdef int number, x, y, z
    if _same_arrangement(source_at, target_at):
        done = triples_transform_wide(source, source_at.step, target, source_at, count, bytes_after, rigid)
    source += done * source_at.step
    target += done * target_at.step
    count -= done
    number = _common_number(source_at)
    if number == FLOAT32:
        _transform_each(source, source_at, target, target_at, count, rigid, FLOAT32, FLOAT32, FLOAT32)
    elif number == FLOAT64:
        _transform_each(source, source_at, target, target_at, count, rigid, FLOAT64, FLOAT64, FLOAT64)
    elif number == OTHER_FLOAT32:
        _transform_each(
            source, source_at, target, target_at, count, rigid, OTHER_FLOAT32, OTHER_FLOAT32, OTHER_FLOAT32
        )
    elif number == OTHER_FLOAT64:
        _transform_each(
            source, source_at, target, target_at, count, rigid, OTHER_FLOAT64, OTHER_FLOAT64, OTHER_FLOAT64
        )
    else:
        x, y, z = source_at.numbers[0], source_at.numbers[1], source_at.numbers[2]
        _transform_each(source, source_at, target, target_at, count, rigid, x, y, z)
