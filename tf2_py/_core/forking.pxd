"""The locks that a fork leaves free."""

from libc.stdint cimport uint32_t

from tf2_py._core.lock cimport Lock

cdef enum ForkOrder:
    # Whoever holds a lock takes none of the same or an earlier place.
    FORK_OUTER              # a receiver's: held while the engine inserts
    FORK_INNER              # all others
    FORK_ORDERS             # how many there are


cdef extern from "<pthread.h>" nogil:
    ctypedef unsigned long pthread_t


cdef struct ForkNote:
    # A thread of a process.
    uint32_t generation     # of the process: how many forks lie between it and the first one
    pthread_t thread


cdef struct ForkedLock:
    # A lock in the list of its order. Lives where the lock lives, and must not move.
    Lock* lock
    int order               # a ForkOrder
    ForkedLock* before
    ForkedLock* after


# From here to `fork_forget`, a fork waits until nobody holds the lock, and finds what it guards whole.
cdef void fork_watch(ForkedLock* forked, Lock* lock, int order) noexcept nogil
# Without effect on one that was zeroed and never watched.
cdef void fork_forget(ForkedLock* forked) noexcept nogil
# Notes who is running, and tells later whether he still is: in a forked child only the one who forked is.
cdef void fork_note(ForkNote* note) noexcept nogil
cdef bint fork_is_here(const ForkNote* note) noexcept nogil
cdef uint32_t fork_generation() noexcept nogil
