"""Lookups at many times in one call."""

from libc.stdint cimport int64_t

from tf2_py._core.lock cimport Lock
from tf2_py._core.lookup cimport Query
from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport Status


cdef struct TimeSeries:
    # What one call asks for and where its answers go; exactly one of `translations` and `points` is set.
    const int64_t* times_ns     # the source's times
    Py_ssize_t count
    double* translations        # (count, 3)
    double* rotations           # (count, 4), x y z w
    const double* points        # (count, 3): to be carried each with its own time
    double* carried             # (count, 3)
    bint nan_missing            # fill NaN where there is no answer, instead of stopping there


# Answers of `query` at each of the times; its own source time is not looked at. How many were answered: less
# than `count` where the one after them failed, with its status. Takes the lock, but not for long.
cdef Py_ssize_t series_lookup(const Tree* tree, Lock* lock, const Query* query, const TimeSeries* series,
                              Status* status) noexcept nogil
