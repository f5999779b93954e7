# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lookups at many times in one call."""

cdef struct TimeSeries:
    # The times of one call and the memory for its answers: `translations` and `rotations`, or `matrices`, or
    # `points` and `transformed`; the others are NULL.
    const int64_t* times_ns     # the source's times
    Py_ssize_t count            # of the times
    double* translations        # (count, 3), meters
    double* rotations           # (count, 4), x y z w
    double* matrices            # (count, 16), row by row
    const double* points        # (count, 3), meters: to be transformed, each with its own time
    double* transformed         # (count, 3), meters: the transformed points
    bint nan_missing            # fill in NaN if there is no answer, instead of stopping


cdef inline void series_begin(TimeSeries* series, const int64_t* times_ns, Py_ssize_t count) noexcept nogil:
    # The rest is nothing, until the caller sets what it needs.
    memset(series, 0, sizeof(TimeSeries))
    series.times_ns = times_ns
    series.count = count


cdef enum:
    SERIES_BAD_NAME = -1        # a frame's name is invalid or unknown: `status` says which
    SERIES_NO_MEMORY = -2


# Answers `query` at each of the times, which replace its source time, from the state of the tree at one
# moment. Returns how many are answered, NaN included; fewer than `count`: the next one failed with `status`;
# or one of SERIES_BAD_NAME and SERIES_NO_MEMORY. Call it without the lock, which it holds for a short time
# only.
cdef Py_ssize_t series_lookup(const Tree* tree, Lock* lock, const Query* query, const TimeSeries* series,
                              Status* status) noexcept nogil
