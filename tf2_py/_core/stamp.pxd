"""A stamp as one count of nanoseconds, and as the seconds and nanoseconds of a message."""

from libc.stdint cimport int64_t, uint32_t

cdef enum:
    NS_PER_S = 1000000000


cdef inline int64_t stamp_join(int64_t sec, int64_t nanosec) noexcept nogil:
    # For a `sec` of 32 bits, any `nanosec` of 32 bits.
    return sec * NS_PER_S + nanosec


cdef inline void stamp_split(int64_t stamp_ns, int64_t* sec, uint32_t* nanosec) noexcept nogil:
    # `nanosec` is below NS_PER_S before the epoch, too: C's division rounds towards zero.
    cdef int64_t rest = stamp_ns % NS_PER_S
    sec[0] = stamp_ns // NS_PER_S
    if rest < 0:
        sec[0] -= 1
        rest += NS_PER_S
    nanosec[0] = <uint32_t>rest
