"""NumPy arrays as C pointers."""

# Uses: times.

# The numbers of a C-contiguous array, whose owner must neither free nor resize it meanwhile. ValueError: they
# are of another type, or a row does not have `width` of them. `width` 0: the array has one dimension.
cdef double* doubles_of(object array, Py_ssize_t width) except NULL
cdef int64_t* int64s_of(object array) except NULL
cdef uint32_t* uint32s_of(object array, Py_ssize_t width) except NULL

# A matrix of shape (4, 4) for a caller: a new one; or `out`, checked: float64 if it can be filled through
# matrix_of, else any array of floats, into which NumPy has to convert.
cdef object new_matrix()
cdef bint require_matrix(object out) except -1  # whether matrix_of may be used
cdef double* matrix_of(object matrix) noexcept

cdef object new_array(tuple shape, str dtype=*)
cdef object received_array(value, str dtype)
cdef tuple as_points(points)
