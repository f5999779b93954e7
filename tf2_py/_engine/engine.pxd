"""The tree behind its lock, with whoever waits for it."""

cimport cython
from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.forking cimport ForkedLock
from tf2_py._core.lock cimport Lock
from tf2_py._core.lookup cimport Query
from tf2_py._core.tree cimport Limits, Tree
from tf2_py._core.types cimport Status, Transform
from tf2_py._core.waiters cimport Waiter, WaiterList, Waiters
from tf2_py._wire.batch cimport Batch


cdef extern from "<semaphore.h>" nogil:
    ctypedef struct sem_t:
        pass


cdef Limits NO_LIMITS


cdef enum:
    SLICE = 64      # what is done under one lock, in inserts of one transform: some tens of microseconds


cdef class Engine:
    cdef Tree _tree                     # with the waiters, read and written under _lock only
    cdef Waiters _waiters
    cdef Lock _lock
    cdef ForkedLock _forked             # _lock
    cdef readonly object _throttle      # of log lines
    cdef unsigned long long _malformed      # messages; guarded by the GIL
    cdef unsigned long long _waits_refused  # likewise
    cdef list _observers                # called after every insert; changed with the GIL, counted without

    # Takes a slice of what a begun batch holds; whether more is left. Where `batch.needs_report` is set
    # after the last one, `report` is due, with the GIL and while the batch and its names are still there.
    cdef bint insert_some(self, Batch* batch) noexcept nogil
    # The same of the whole batch. What takes longer than one slice lets other threads run.
    cdef void insert(self, Batch* batch)
    # `later`: a list of what would run a user's code, for the caller to hand over; None: it runs at once.
    cdef int report(self, Batch* batch, list later) except -1
    # Counts a message that could not be read, and makes the ValueError that says why. `size`: its bytes.
    cdef object malformed(self, const Batch* batch, size_t size)
    cdef int forget(self) except -1
    # As if newly made; whoever waits goes on waiting.
    cdef int start_over(self, int64_t cache_time_ns, const Limits* limits) except -1
    # `out` NULL only asks whether there is an answer.
    cdef Status lookup(self, const Query* query, Transform* out, int64_t* stamp_ns) noexcept nogil
    # The exception for a status; `call` is what it says was called.
    cdef object error(self, const Query* query, Status status, str call=*)
    cdef int _log_refused(self, Batch* batch) except -1
    cdef void _insert_next(self, Batch* batch, uint32_t authority) noexcept nogil
    # The first of the errors that came.
    cdef object _deliver(self, WaiterList* ready, list later)
    cdef void _begin_to_wake_all(self, Batch* batch) noexcept nogil
    cdef int _wake_all(self, Batch* batch) except -1
    cdef object _too_many_waiters(self)


@cython.final
@cython.no_gc_clear
cdef class Wait:
    # Waits for one lookup, from its making until it is answered, cancelled or dropped. The collector must not
    # clear it: `_engine` is needed to leave.
    cdef Waiter _waiter                 # under the engine's lock
    cdef Engine _engine
    cdef tuple _names                   # keeps the query's UTF-8 alive
    cdef object _notify                 # called with the answer, or None: a thread blocks
    cdef sem_t _woken                   # posted with the answer, where a thread blocks

    cdef void _leave(self) noexcept nogil
    cdef int _begin(self, Engine engine, tuple names, const Query* query, object notify) except -1
