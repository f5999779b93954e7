"""How often something is logged."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint64_t

from tf2_py._wire.batch cimport Batch

cdef enum:
    LINES_PER_MESSAGE = 10
    LINES_PER_SECOND = 20


cdef struct Recent:
    # What was logged within the last second.
    uint64_t keys[LINES_PER_SECOND]
    int64_t until_ns[LINES_PER_SECOND]      # steady time; an entry whose time has passed is free


cdef class Throttle:
    # Read and written with the GIL held.
    cdef Recent _refused
    cdef Recent _others
    cdef uint64_t _unlogged             # refused transforms that were not logged, since the last summary
    cdef int64_t _summary_ns            # steady time before which there is no further summary

    # The entries to log, at most LINES_PER_MESSAGE of them, into `chosen`; their number is returned. `more`
    # receives how many others a summary is to count, 0 where none is due.
    cdef size_t choose(self, const Batch* batch, size_t* chosen, uint64_t* more) noexcept
