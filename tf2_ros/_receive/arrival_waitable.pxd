"""How many messages a receiver took, and how many of them no round of an executor has accounted for."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint64_t

from tf2_py._internal cimport ForkedLock, Lock
from tf2_ros._receive.rcl cimport rcl_guard_condition_t

cdef enum:
    MAX_SOURCES = 2             # dynamic and static transforms


cdef struct ArrivalCounts:
    Lock lock
    ForkedLock forked               # lock
    uint64_t unseen[MAX_SOURCES]    # messages of each source that no round of an executor has accounted for
    uint64_t depths[MAX_SOURCES]    # of the queues: more messages an executor would not have found there
    uint64_t taken[MAX_SOURCES]     # all messages of each source, ever
    int64_t taken_at_ns[MAX_SOURCES]    # steady time of the last of them; 0: none
    bint waiting                    # an executor sleeps, and must wake for each message
    int64_t wake_at_ns              # or sleeps in its own loop, and must wake for one from then on; or 0
    bint round_due                  # it was woken so
    rcl_guard_condition_t* guard    # wakes it


# One message of a source was taken, at a steady time.
cdef void arrivals_took(ArrivalCounts* arrivals, size_t source, int64_t now_ns) noexcept nogil
# Counts one message of a source for executors, and wakes the executor where it must. Not with any lock held
# but the GIL.
cdef void arrivals_count(ArrivalCounts* arrivals, size_t source) noexcept nogil


cdef class ArrivalWaitable:
    cdef ArrivalCounts _counts
    cdef object _handle             # keeps the guard condition
    # One entry for each message that completed something: it counts for that message, too.
    cdef readonly object completed
    cdef readonly bint spun         # by any executor, ever
    cdef bint _in_user_code         # user code called the executor and continues before it sleeps again
    cdef void* _wait_set            # of the executor that went to sleep last, where it has not woken yet

    cdef bint _has_any(self, bint waiting)
