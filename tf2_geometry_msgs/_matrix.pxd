"""Rotated covariances: 3x3 matrices on C doubles, row by row."""


cdef inline void matrix_sandwich(const double* r, const double* c, double* out) noexcept nogil:
    # out = r c r^T.
    cdef double half[9]
    cdef int i, j
    for i in range(3):
        for j in range(3):
            half[3 * i + j] = r[3 * i] * c[j] + r[3 * i + 1] * c[3 + j] + r[3 * i + 2] * c[6 + j]
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = (
                half[3 * i] * r[3 * j] + half[3 * i + 1] * r[3 * j + 1] + half[3 * i + 2] * r[3 * j + 2]
            )


cdef inline void covariance_rotate(const double* r, const double* c, int side, double* out) noexcept nogil:
    # Each 3x3 block b of the `side` x `side` matrix c becomes r b r^T. Rounding must not cost the symmetry
    # that filters rely on: the mean of r b r^T and (r b^T r^T)^T, equal but for rounding, gives for a
    # block's transpose the transpose of the result, bit by bit.
    cdef double block[9]
    cdef double transposed[9]
    cdef double straight[9]
    cdef double mirrored[9]
    cdef int row, column, i, j
    for row in range(0, side, 3):
        for column in range(0, side, 3):
            for i in range(3):
                for j in range(3):
                    block[3 * i + j] = c[side * (row + i) + column + j]
                    transposed[3 * j + i] = block[3 * i + j]
            matrix_sandwich(r, block, straight)
            matrix_sandwich(r, transposed, mirrored)
            for i in range(3):
                for j in range(3):
                    out[side * (row + i) + column + j] = 0.5 * straight[3 * i + j] + 0.5 * mirrored[3 * j + i]
