"""Owns the wait for one lookup: its answer as a message, and the thread that blocks until it is available."""

cimport cython
from cpython.exc cimport PyErr_CheckSignals
from libc.stdint cimport int64_t

from threading import get_ident, main_thread

from tf2_py._core.clock cimport monotonic_ns
from tf2_py._core.event cimport Event, event_free, event_init, event_set, event_wait
from tf2_py._core.flag cimport flag_is_set
from tf2_py._core.lookup cimport Query
from tf2_py._core.names cimport name_is_invalid
from tf2_py._core.types cimport (
    STATUS_BAD_FIXED,
    STATUS_BAD_SOURCE,
    STATUS_BAD_TARGET,
    STATUS_OK,
    Status,
    Transform,
)
from tf2_py._core.waiters cimport Waiter, waiter_free
from tf2_py._engine.engine cimport Engine, WaiterOwner
from tf2_py._objects.messages cimport new_transform_stamped

# How often a blocked thread looks for the end of its context ...
cdef int64_t WAKE_CHECK_NS = 100 * <int64_t>1000000
# ... and the main thread for signals, too, which do not end its sleep. tf2's waits look as often.
cdef int64_t SIGNAL_CHECK_NS = 20 * <int64_t>1000000


cdef bint _post(Waiter* waiter) noexcept nogil:
    # To a blocked thread the answer is delivered without the GIL.
    event_set(<Event*>waiter.woken)
    return True


cdef bint _leave_ready(Waiter* waiter) noexcept nogil:
    return False


@cython.final
@cython.no_gc_clear
cdef class Wait(WaiterOwner):
    """The wait for one lookup. Engines make them; dropping the last reference ends the wait."""

    def __init__(self):
        raise TypeError("a Wait is made by BufferCore._wait()")

    def __dealloc__(self):
        if self._engine is not None:
            self._engine.remove_waiter(&self._waiter)
            if self._notify is None:
                event_free(&self._woken)
        waiter_free(&self._waiter)

    cdef object deliver(self):
        return self._notify(self.answer)

    cdef int begin(self, Engine engine, tuple names, const Query* query, object notify) except -1:
        cdef Status status
        if notify is None and event_init(&self._woken) != 0:
            raise MemoryError
        self._names = names
        self._notify = notify
        self._waiter.query = query[0]
        self._waiter.owner = <void*>self
        self._waiter.woken = &self._woken
        self._waiter.deliver = _post if notify is None else _leave_ready
        self._engine = engine
        engine.add_waiter(&self._waiter, &status)
        if status.code == STATUS_OK:
            return 0
        # With such a name there will never be an answer, whatever else is missing.
        if name_is_invalid(query.target, query.target_size):
            status.code = STATUS_BAD_TARGET
        elif name_is_invalid(query.source, query.source_size):
            status.code = STATUS_BAD_SOURCE
        elif query.fixed != NULL and name_is_invalid(query.fixed, query.fixed_size):
            status.code = STATUS_BAD_FIXED
        else:
            return 0
        engine.remove_waiter(&self._waiter)
        raise engine.error(query, status)

    @property
    def answer(self):
        """A new message of the answer, or None."""
        if not flag_is_set(&self._waiter.answered):
            return None
        target, source, _ = self._names
        return new_transform_stamped(&self._waiter.answer, self._waiter.stamp_ns, target, source)

    def cancel(self):
        """End the wait. Returns whether it was pending, that is, not answered and not ended before."""
        return self._engine.remove_waiter(&self._waiter)

    def reason(self):
        """What a lookup raises now: the exception, or None where it would answer."""
        cdef int64_t stamp_ns
        # Without it, the halves of a two-time lookup would be tried in the order of a can_transform.
        cdef Transform not_needed
        cdef Status status = self._engine.lookup(&self._waiter.query, &not_needed, &stamp_ns)
        return None if status.code == STATUS_OK else self._engine.error(&self._waiter.query, status)

    cpdef str lacks(self):
        """One line, for debugging a wait that does not end: what it waits for, and what it lacks now."""
        return self._engine.lack(&self._waiter.query)

    def wait_for(self, int64_t timeout_ns, alive):
        """
        Sleep, without the GIL, until the answer is available.

        :param timeout_ns: nanoseconds of steady time.
        :param alive: called without arguments, at least every 100 ms; False ends the wait.
        :return: whether there is an answer. The wait ends in any case, also where a signal handler raises.
        """
        cdef int64_t deadline_ns = monotonic_ns() + timeout_ns
        cdef int64_t check_ns = SIGNAL_CHECK_NS
        cdef int64_t left_ns = timeout_ns
        cdef bint is_woken = False
        try:
            while not flag_is_set(&self._waiter.answered):
                if not alive():
                    break
                with nogil:
                    is_woken = event_wait(&self._woken, max(min(left_ns, check_ns), 0))
                PyErr_CheckSignals()
                if is_woken:
                    continue
                left_ns = deadline_ns - monotonic_ns()
                if left_ns <= 0:
                    break
                if check_ns == SIGNAL_CHECK_NS and get_ident() != main_thread().ident:
                    check_ns = WAKE_CHECK_NS
        finally:
            self._engine.remove_waiter(&self._waiter)
        # The waiter may have been answered between the last sleep and the removal.
        return self._waiter.answered
