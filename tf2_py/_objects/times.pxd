"""Times and durations as nanoseconds, and back."""

from libc.stdint cimport int64_t

from tf2_py._objects.layout cimport Layout

# Of builtin_interfaces/Time; None before load_time() has run.
cdef Layout time_layout
cdef enum:
    TIME_SEC = 0            # the fields of it
    TIME_NANOSEC = 1
cdef int load_time() except -1

# Of a time: anything with `nanoseconds`, or with `sec` and `nanosec`; an integer, which is nanoseconds; a
# numpy.datetime64; or a pandas.Timestamp. TypeError, whose text begins with `argument`, for anything else;
# ValueError for NaT; OverflowError for what does not fit into 64 bits.
cdef int64_t nanoseconds(object value, str argument) except? -1
# Of a time as a stamp: OverflowError also for what no message can carry.
cdef int64_t stamp_nanoseconds(object value, str argument) except? -1
# Of a duration: the same without the integers, datetime64 and Timestamp.
cdef int64_t duration_nanoseconds(object value, str argument) except? -1
cdef int64_t duration_or_seconds(object value, str argument) except? -1
cdef object new_stamp(int64_t stamp_ns)     # a builtin_interfaces/Time
cdef object new_time(int64_t time_ns)       # an rclpy.time.Time, or a stamp without rclpy
