"""Times between which a transform changes nearly linearly."""

# Uses: types, geometry, sync, history, tree, lookup, series.

cdef enum:
    SERIES_UNSTEADY = -3        # the next one after the errors of series_lookup


# Times from `first_ns` to `last_ns`, ascending, so close that between two of them the transform of a simple
# lookup differs by at most `turn` and `move` from the linear interpolation of its matrix: `turn` is how far a
# point at 1 m is off, `move` how far the origin is, in meters. Returns their number, and in `knots_ns` memory
# to be freed with `free`; or an error of series_lookup; or SERIES_UNSTEADY: the path depends on the time, or
# there is none; or the transform jumps, because two samples have the same stamp; or there are more than
# `most`. Call it without the lock.
cdef Py_ssize_t series_knots(const Tree* tree, Lock* lock, const Query* query, int64_t first_ns,
                             int64_t last_ns, double turn, double move, Py_ssize_t most, int64_t** knots_ns,
                             Status* status) noexcept nogil
