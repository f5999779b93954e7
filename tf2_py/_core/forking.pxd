"""Locks that no fork leaves locked in the child."""

from libc.stdint cimport uint32_t

from tf2_py._core.lock cimport Lock

cdef enum ForkOrder:
    # A thread that holds a lock takes no other of the same or an earlier order.
    FORK_OUTER              # a receiver's: held while the engine inserts
    FORK_INNER              # all others

cdef enum:
    FORK_ORDERS = 2         # how many there are


cdef extern from "<pthread.h>" nogil:
    ctypedef unsigned long pthread_t


cdef struct ForkThread:
    # A thread, as recorded at some time.
    uint32_t generation     # how many forks lay between its process and the first one
    pthread_t thread


cdef struct ForkedLock:
    # A lock in the list of its order. It must not move while it is listed.
    Lock* lock              # NULL: not listed
    # NULL, or what is called in a forked child with `owner`, while no other thread exists.
    void (*in_child)(void* owner) noexcept nogil
    void* owner
    int order               # a ForkOrder
    ForkedLock* previous
    ForkedLock* next


# Zeroed before, but for `in_child` and `owner`. From here to `fork_forget`, a fork waits for the lock, so
# that the child finds what it guards consistent.
cdef void fork_watch(ForkedLock* forked, Lock* lock, int order) noexcept nogil
# No effect on a zeroed one that was never watched.
cdef void fork_forget(ForkedLock* forked) noexcept nogil
# Records the calling thread. Later: whether it exists in this process; in a forked child only the thread
# that forked does.
cdef void fork_record_thread(ForkThread* thread) noexcept nogil
cdef bint fork_thread_exists(const ForkThread* thread) noexcept nogil
# How many forks lie between this process and the first one.
cdef uint32_t fork_generation() noexcept nogil
