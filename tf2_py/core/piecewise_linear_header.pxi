# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses between which a transform changes nearly linearly."""

cdef enum:
    SERIES_UNSTEADY = -3        # the next one after the errors of series_lookup


cdef struct Knots:
    # The period, and how exact the transforms between two of the knots are.
    int64_t first_ns
    int64_t last_ns
    double turn             # how far a point at 1 m may be off because of the rotation, meters
    double move             # how far the origin of the source may be off, meters
    Py_ssize_t most         # knots
    # What series_knots finds.
    int64_t* times_ns       # ascending, from `first_ns` to `last_ns`
    double* matrices        # at these: (count, 16), row by row


# Finds knots between which linear interpolation of the matrix is off by at most `turn` and `move`: times, and
# the answers of `query` at these times (the transform of the source in the target, or in the fixed frame if
# there is one), all in one state of the tree. Returns their number, or
# SERIES_NO_MEMORY
# SERIES_UNSTEADY    the path depends on the time, or there is none; a lookup fails; the transform jumps,
#                    because two samples have the same stamp; or there are more than `most` knots.
# Call it without the lock, and knots_free afterwards.
cdef Py_ssize_t series_knots(const Tree* tree, Lock* lock, const Query* query, Knots* knots) noexcept nogil


cdef inline void knots_free(Knots* knots) noexcept nogil:
    free(knots.times_ns)
    free(knots.matrices)
