"""Lookups at many times in one call."""

from libc.stdint cimport int64_t

from tf2_py._core.lock cimport Lock
from tf2_py._core.lookup cimport Query
from tf2_py._core.tree cimport Tree
from tf2_py._core.types cimport Status


cdef struct TimeSeries:
    # The times of one call and the memory for its answers: either `translations` and `rotations`, or `points`
    # and `transformed`; the other two are NULL.
    const int64_t* times_ns     # the source's times
    Py_ssize_t count            # of the times
    double* translations        # (count, 3), metres
    double* rotations           # (count, 4), x y z w
    const double* points        # (count, 3), metres: to be transformed, each with its own time
    double* transformed         # (count, 3), metres: the transformed points
    bint nan_missing            # fill NaN where there is no answer, instead of stopping there


# Answers `query` at each of the times, which replace its source time. Returns how many are answered; fewer
# than `count`: the next one failed with `status`. Call it without the lock: it holds it for short times.
cdef Py_ssize_t series_lookup(const Tree* tree, Lock* lock, const Query* query, const TimeSeries* series,
                              Status* status) noexcept nogil
