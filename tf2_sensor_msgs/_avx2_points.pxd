# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
What avx2_points.h has: transform points, read the span of their times, and move each with its own pose, with
AVX2; and the search among knots.
"""

from libc.stddef cimport ptrdiff_t
from libc.stdint cimport int64_t


cdef extern from "tf2_sensor_msgs/avx2_points.h":
    bint avx2_is_supported() noexcept nogil     # whether the machine can do what follows
    # x y z lie beside each other, in this machine's byte order, at the start of each of `count` points that
    # do not overlap. `source` and `target` may be the same if the steps are equal; otherwise `target_step` is
    # that of three numbers. After the last z, as many bytes as a number has must be accessible in both; in
    # the target they are written as they were read.
    # Returns how many points were done, from the first on.
    size_t avx2_floats(const char* source, size_t step, char* target, size_t target_step, size_t count,
                       const double* matrix, const double* translation) noexcept nogil
    size_t avx2_doubles(const char* source, size_t step, char* target, size_t target_step, size_t count,
                        const double* matrix, const double* translation) noexcept nogil

    struct TimeSource:
        ptrdiff_t offset
        int number
        int64_t unit_ns
        int64_t base_ns
        double minus
        double times
        double plus

    struct PoseKnots:
        const double* ns
        const double* columns
        const double* slopes
        size_t last

    struct FieldSpan:
        double lowest
        double highest
        int64_t points
        int64_t finite
        int64_t large

    bint knots_include(const PoseKnots* knots, double ns) noexcept nogil
    # The index of the last knot that is not later than the time; 0 if there is none.
    size_t knot_before(const PoseKnots* knots, double ns) noexcept nogil
    # Extends the span by the points whose number can be read, as avx2_move_floats, without NaN.
    size_t avx2_extend_span(const char* points, size_t step, size_t count, ptrdiff_t xyz,
                            const TimeSource* time, FieldSpan* span) noexcept nogil
    # As avx2_floats, in place, for points that each have a time and so a pose of their own. `xyz`:
    # the offset of x y z in a point. Stops at a point whose time is not between the knots.
    size_t avx2_move_floats(char* points, size_t step, size_t count, ptrdiff_t xyz, const TimeSource* time,
                            const PoseKnots* knots) noexcept nogil
