"""The steady clock, for deadlines and periods, which does not jump when the time of day is set; and that."""

from libc.stdint cimport int64_t
from posix.time cimport CLOCK_MONOTONIC, CLOCK_REALTIME, clock_gettime, nanosleep, timespec

from tf2_py._core.stamp cimport NS_PER_S


cdef inline int64_t monotonic_ns() noexcept nogil:
    cdef timespec now
    clock_gettime(CLOCK_MONOTONIC, &now)
    return now.tv_sec * <int64_t>NS_PER_S + now.tv_nsec


# Since 1970, as ROS counts it.
cdef inline int64_t system_ns() noexcept nogil:
    cdef timespec now
    clock_gettime(CLOCK_REALTIME, &now)
    return now.tv_sec * <int64_t>NS_PER_S + now.tv_nsec


# Shorter where a signal arrives.
cdef inline void sleep_ns(int64_t ns) noexcept nogil:
    cdef timespec duration
    duration.tv_sec = ns // NS_PER_S
    duration.tv_nsec = ns % NS_PER_S
    nanosleep(&duration, NULL)
