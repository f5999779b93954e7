"""Lookups at many times in one call."""

# Uses: types, geometry, sync, history, tree, lookup.

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
    SERIES_UNSTEADY = -3        # see series_knots


# Answers `query` at each of the times, which replace its source time, from the state of the tree at one
# moment. Returns how many are answered, NaN included; fewer than `count`: the next one failed with `status`;
# or one of SERIES_BAD_NAME and SERIES_NO_MEMORY. Call it without the lock, which it holds for a short time
# only.
cdef Py_ssize_t series_lookup(const Tree* tree, Lock* lock, const Query* query, const TimeSeries* series,
                              Status* status) noexcept nogil


# Times from `first_ns` to `last_ns`, ascending, so close that between two of them the transform of a simple
# lookup differs by at most `turn` and `move` from the linear interpolation of its matrix: `turn` is how far a
# point at 1 m is off, `move` how far the origin is, in meters. Returns their number, and in `knots_ns` memory
# to be freed with `free`; or one of the errors above. SERIES_UNSTEADY: the path depends on the time, or there
# is none; or the transform jumps, because two samples have the same stamp; or there are more than `most`.
# Call it without the lock.
cdef Py_ssize_t series_knots(const Tree* tree, Lock* lock, const Query* query, int64_t first_ns,
                             int64_t last_ns, double turn, double move, Py_ssize_t most, int64_t** knots_ns,
                             Status* status) noexcept nogil


cdef inline void twist_interval(int64_t time_ns, int64_t interval_ns, int64_t common_ns,
                                int64_t* start_ns, int64_t* end_ns) noexcept nogil:
    # From when to when the mean twist around a time, which is at least 1, is taken. Neither is 0, "latest".
    # After the latest common time, only a frame with several parents has answers; its interval ends at the
    # time, and if that has no answer, there is no twist.
    cdef int64_t after_ns = interval_ns - interval_ns // 2
    start_ns[0] = max(time_ns - interval_ns // 2, 1)
    end_ns[0] = time_ns + min(after_ns, INT64_MAX - time_ns)
    if common_ns and end_ns[0] > common_ns:
        end_ns[0] = max(common_ns, time_ns)
