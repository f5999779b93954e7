"""An engine whose tree other processes read, or that reads the tree of another process."""

cimport cython
from libc.stdint cimport int64_t, uint64_t

from tf2_py._engine.engine cimport Engine
from tf2_py._wire.batch cimport Batch


@cython.no_gc_clear
cdef class SharingEngine(Engine):
    cdef uint64_t _followed     # the sequence whose changes the waiters know of; under _lock
    cdef object _begin_following    # called when something begins to wait for another process; or None
    cdef bint _is_interrupted   # a flag, see flag.pxd; so is the next
    cdef bint _is_expected      # an executor sleeps until the next change

    cdef void _after_fork(self) noexcept nogil
    cdef void _take_leave_now(self) noexcept nogil
    cdef bint _follows(self) noexcept nogil
    cdef bint _is_wanted(self) noexcept nogil
    cdef bint _next_change(self, Batch* batch, int64_t ns) noexcept nogil
    cdef bint _take_change(self, Batch* batch) noexcept nogil
