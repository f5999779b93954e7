# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Times and durations as nanoseconds, and back."""

# The layout of builtin_interfaces/Time; None before load_time() has run.
cdef Layout time_layout
cdef enum:
    TIME_SEC = 0            # the fields of it
    TIME_NANOSEC = 1
cdef int load_time() except -1

# Reads a time: anything with `nanoseconds`, or with `sec` and `nanosec`; an integer of nanoseconds; a
# numpy.datetime64; or a pandas.Timestamp. Raises a TypeError, whose text begins with `argument`, for anything
# else; a ValueError for NaT; an OverflowError if the time does not fit into 64 bits.
cdef int64_t nanoseconds(object value, str argument) except? -1
# Reads a time as a stamp; also raises an OverflowError if no message can hold it.
cdef int64_t stamp_nanoseconds(object value, str argument) except? -1
cdef bint is_stamp(int64_t time_ns) noexcept    # whether a message can hold it
cdef str no_stamp(int64_t time_ns)              # the text of the OverflowError if not
cpdef int64_t duration_ns(object duration, str argument) except? -1
cdef object new_stamp(int64_t stamp_ns)     # a builtin_interfaces/Time
cdef object new_time(int64_t time_ns)       # an rclpy.time.Time, or a stamp without rclpy
