# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Convert the arrays that callers pass to one dtype and shape, and to C pointers; convert rotations."""


# Not typed memoryviews: what Cython needs for them is as large as half of this extension.

cdef void* _numbers(object array, const char* formats, Py_ssize_t size, Py_ssize_t width) except NULL:
    cdef Py_buffer view
    cdef bint fits
    PyObject_GetBuffer(array, &view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT)
    # A format of one character: native byte order, and one number for each element.
    fits = (view.itemsize == size and strlen(view.format) == 1 and strchr(formats, view.format[0]) != NULL
            and (view.ndim == 2 and view.shape[1] == width if width else view.ndim == 1))
    PyBuffer_Release(&view)
    if not fits:
        raise ValueError(f"unexpected dtype or shape: {array.dtype}, {array.shape}")
    return view.buf


# The numbers of a C-contiguous array, whose owner must neither free nor resize it meanwhile. ValueError: they
# are of another type, or a row does not have `width` of them. `width` 0: the array has one dimension.

cdef double* doubles_of(object array, Py_ssize_t width) except NULL:
    return <double*>_numbers(array, "d", sizeof(double), width)


cdef int64_t* int64s_of(object array) except NULL:
    return <int64_t*>_numbers(array, "lq", sizeof(int64_t), 0)


cdef uint32_t* uint32s_of(object array, Py_ssize_t width) except NULL:
    return <uint32_t*>_numbers(array, "IL", sizeof(uint32_t), width)


# NumPy is imported by the first call that needs it, because the engine itself does not.

cdef object new_array(tuple shape, str dtype="float64"):
    # An uninitialized array.
    import numpy as np
    return np.empty(shape, dtype)


# Single matrices are made and filled through NumPy's C functions, which take a fifth of the time. These are
# not cimported, as they are where points are transformed, because `cimport numpy` imports NumPy together with
# the extension, and tf2_py needs neither NumPy nor the time of its import, which is longer than its own.

cdef extern from "numpy/arrayobject.h":
    ctypedef Py_ssize_t npy_intp
    ctypedef struct PyArrayObject:
        pass
    const int NPY_DOUBLE
    void** PyArray_API
    int import_numpy "_import_array" () except -1
    object PyArray_SimpleNew(int ndim, const npy_intp* shape, int type)
    bint PyArray_Check(object value)
    bint PyArray_CheckExact(object value)
    int PyArray_NDIM(const PyArrayObject* array) noexcept
    npy_intp PyArray_DIM(const PyArrayObject* array, int axis) noexcept
    int PyArray_TYPE(const PyArrayObject* array) noexcept
    bint PyArray_ISFLOAT(const PyArrayObject* array) noexcept
    bint PyArray_ISWRITEABLE(const PyArrayObject* array) noexcept
    bint PyArray_ISCARRAY(const PyArrayObject* array) noexcept   # contiguous, aligned, of native byte order
    void* PyArray_DATA(PyArrayObject* array) noexcept


cdef int _require_numpy() except -1:
    return import_numpy() if PyArray_API == NULL else 0


# A matrix of shape (4, 4) for a caller: a new one; or `out`, checked: float64 if it can be filled through
# matrix_of, else any array of floats, into which NumPy has to convert.

cdef object new_matrix():
    cdef npy_intp[2] shape = [4, 4]
    _require_numpy()
    return PyArray_SimpleNew(2, shape, NPY_DOUBLE)


cdef bint require_matrix(object out) except -1:
    # Whether matrix_of may be used.
    cdef PyArrayObject* array = <PyArrayObject*><PyObject*>out
    _require_numpy()
    if not PyArray_Check(out):
        raise TypeError(f"out: expected a NumPy array of floats, got {type(out).__name__}")
    if not PyArray_ISFLOAT(array):
        raise TypeError(f"out: expected an array of floats, got dtype {out.dtype}")
    if PyArray_NDIM(array) != 2 or PyArray_DIM(array, 0) != 4 or PyArray_DIM(array, 1) != 4:
        raise ValueError(f"out: expected the shape (4, 4), got {out.shape}")
    if not PyArray_ISWRITEABLE(array):
        raise ValueError("out: expected a writable array, got a read-only one")
    return PyArray_CheckExact(out) and PyArray_TYPE(array) == NPY_DOUBLE and PyArray_ISCARRAY(array)


cdef double* matrix_of(object matrix) noexcept:
    return <double*>PyArray_DATA(<PyArrayObject*><PyObject*>matrix)


cdef object received_array(value, str dtype):
    # An array from outside, made contiguous, aligned and of this machine's byte order; a copy if necessary.
    import numpy as np
    return np.require(value, dtype, ["C_CONTIGUOUS", "ALIGNED"])


def mask_of(values):
    """
    The mask of a masked array of NumPy; None if nothing is masked, and for anything else.

    This does not use ``numpy.ma``, which NumPy imports when it is first used: a fork meanwhile would leave
    the lock of that import taken.
    """
    import numpy as np
    mask = getattr(values, "mask", None)
    return mask if isinstance(mask, np.ndarray) else None


cdef bint is_sequence(value):
    return isinstance(value, Sequence) or hasattr(value, "__array__")


def as_times_ns(times, *, bint accepts_nat=False):
    """
    Times as contiguous int64 nanoseconds of shape (N,); its errors state what is expected. An accepted NaT is
    the least int64.
    """
    import numpy as np
    wanted = "times: expected integer nanoseconds of shape (N,), datetime64, or a sequence of time objects"
    if isinstance(times, str) or not is_sequence(times):
        raise TypeError(f"{wanted}, got {type(times).__name__}")
    if isinstance(times, Sequence) and not _are_numbers(times):
        times = _nanoseconds(times, wanted, accepts_nat)
    try:
        array = np.asarray(times)
        if array.dtype.kind == "f" and not isinstance(times, np.ndarray) and _are_whole(times):
            array = np.asarray(times, object)   # among int64, NumPy makes floats of uint64
    except OverflowError as error:
        raise OverflowError(f"{wanted} that fit into 64 bits: {error}") from None
    if array.size == 0 and not isinstance(times, np.ndarray):
        array = array.astype(np.int64)
    if array.ndim != 1:
        raise ValueError(f"{wanted}; the shape is {array.shape}")
    mask = mask_of(times)
    if mask is not None and mask.any():
        raise _missing(wanted, mask.argmax())
    if array.dtype == object:
        array = np.array(_nanoseconds(array, wanted, accepts_nat), dtype=np.int64)
    if array.dtype.kind == "M":
        return _since_1970(array, wanted, accepts_nat)
    if array.dtype.kind == "f":
        is_nan = np.isnan(array)
        if is_nan.any():
            raise _missing(wanted, is_nan.argmax())
        raise TypeError(f"{wanted}, got dtype {array.dtype}, which rounds nanoseconds: keep those as int64; "
                        "multiply seconds by 1e9, and round them to int64")
    if array.dtype.kind not in "iu":
        raise TypeError(f"{wanted}, got dtype {array.dtype}")
    if array.dtype.kind == "u":
        for i in np.flatnonzero(array > np.iinfo(np.int64).max)[:1]:
            whole_number(int(array[i]), f"times[{i}]")    # raises the error of a single time
    return received_array(array, "int64")


cdef bint _are_numbers(times):
    # Whether all are numbers, or all datetime64: in a mixture, NumPy gives ints the unit of the datetime64.
    import numpy as np
    classes = set(map(type, times))
    numbers = bool not in classes and all([issubclass(each, (int, float, np.number)) for each in classes])
    return numbers or classes == {np.datetime64}


cdef bint _are_whole(times):
    import numpy as np
    return isinstance(times, Sequence) and all([isinstance(each, (int, np.integer)) for each in times])


cdef object _since_1970(times, str wanted, bint accepts_nat):
    # The nanoseconds of datetime64 of any unit.
    import numpy as np
    try:
        exact = times.astype("datetime64[ns]")
        is_exact = exact.astype(times.dtype) == times   # NaT differs from itself
        if accepts_nat:
            is_exact |= np.isnat(times)
        if is_exact.all():
            return np.ascontiguousarray(exact).view(np.int64)
    except OverflowError:  # NumPy before 2.5 wraps around instead
        pass
    # This raises at the first that is not exact.
    return np.array(_nanoseconds(times, wanted, accepts_nat), dtype=np.int64)


cdef object _missing(str wanted, i):
    # A column of integers with a missing value reaches NumPy as floats, or as objects.
    return ValueError(f"{wanted}; times[{i}] is missing (NA, null, NaN or masked)")


cdef bint _is_missing(time):
    return time is None or type(time).__name__ == "NAType" or (isinstance(time, float) and isnan(time))


cdef bint _is_nat(time):
    import numpy as np
    if isinstance(time, np.datetime64):
        return np.isnat(time)
    return type(time).__name__ == "NaTType"     # of pandas


cdef list _nanoseconds(times, str wanted, bint accepts_nat):
    cdef list found = []
    try:
        for i, time in enumerate(times):
            is_nat = accepts_nat and _is_nat(time)
            found.append(INT64_MIN if is_nat else nanoseconds(time, f"times[{i}]"))
        return found
    except TypeError as error:
        if _is_missing(time):
            raise _missing(wanted, i) from None
        # Not a check beforehand: a named tuple with sec and nanosec is a time.
        if isinstance(time, (list, tuple)) or getattr(time, "ndim", 0):
            raise ValueError(f"{wanted}; times[{i}] is a {type(time).__name__}") from None
        raise TypeError(f"{wanted}: {error}") from None


cdef tuple as_points(points):
    # Points as contiguous float64 rows of shape (N, 3), and the dtype of the result: float64 for integers.
    import numpy as np
    if isinstance(points, str):
        raise TypeError(
            "points: expected an array of shape (N, 3), got str: the frames follow points and times"
        )
    array = np.asarray(points)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"points: expected the shape (N, 3), got {array.shape}")
    if array.dtype.kind in "iu":
        array = array.astype(np.float64)
    dtype = array.dtype.newbyteorder("=")
    if dtype not in (np.float32, np.float64):
        raise TypeError(f"points: expected float32, float64 or integers, got {array.dtype}")
    return received_array(array, "float64"), dtype


# The engine's quaternion maths on rows.

def normalize(rotations, *, bint nan_missing=False):
    """
    Normalize each row, a quaternion x y z w, in place.

    :param rotations: float64, shape (N, 4), contiguous and writable.
    :param nan_missing: accept rows in which everything is NaN, and leave them unchanged.
    :return: the index of the first row without a finite length above zero, at which this stops; -1: none.
    """
    cdef double* row = doubles_of(rotations, 4)
    cdef Py_ssize_t i
    for i in range(len(rotations)):
        if not quaternion_normalize_any(row):
            if not (nan_missing and isnan(row[0]) and isnan(row[1]) and isnan(row[2]) and isnan(row[3])):
                return i
        row += 4
    return -1


def matrices_from_rotations(rotations):
    """
    Convert each row to a matrix.

    :param rotations: N rows: unit quaternions x y z w, or NaN; float64, contiguous.
    :return: float64, shape (N, 3, 3).
    """
    cdef Py_ssize_t count = len(rotations)
    cdef const double* row = doubles_of(rotations, 4)
    cdef Py_ssize_t i
    cdef double* matrix
    matrices = new_array((count, 9))
    matrix = doubles_of(matrices, 9)
    for i in range(count):
        matrix_from_quaternion(row + 4 * i, matrix + 9 * i)
    return matrices.reshape(count, 3, 3)
