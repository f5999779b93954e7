"""NumPy arrays as C pointers."""

# The numbers of a C-contiguous array, whose owner must neither free nor resize it meanwhile. ValueError: they
# are of another type, or a row does not have `width` of them. `width` 0: the array has one dimension.
cdef double* doubles_of(object array, Py_ssize_t width) except NULL
cdef int64_t* int64s_of(object array) except NULL
cdef uint32_t* uint32s_of(object array, Py_ssize_t width) except NULL

cdef object new_array(tuple shape, str dtype=*)
cdef object received_array(value, str dtype)
cdef tuple as_points(points)
