"""Times and durations as nanoseconds, and back."""

from libc.stdint cimport int64_t

from tf2_py._objects.layout cimport Layout

# Of builtin_interfaces/Time; None before load_time() has run.
cdef Layout time_layout
cdef enum:
    TIME_SEC = 0            # the fields of it
    TIME_NANOSEC = 1
cdef int load_time() except -1

# Of a time or a duration: anything with `nanoseconds`, or with `sec` and `nanosec`. TypeError, whose text
# begins with `argument`, for anything else; OverflowError for what does not fit into 64 bits.
cdef int64_t nanoseconds(object value, str argument) except? -1
cdef object new_stamp(int64_t stamp_ns)     # a builtin_interfaces/Time
cdef object new_time(int64_t time_ns)       # an rclpy.time.Time, or a stamp without rclpy
