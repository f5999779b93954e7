# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wait for one lookup: its answer as a message, and the thread that blocks until it is available."""

# How often a blocked thread checks whether its context has ended or simulated time has begun ...
cdef int64_t WAKE_CHECK_NS = 100 * <int64_t>1000000
# ... and the main thread also checks for signals, which do not end its sleep. tf2's waits do so as often.
cdef int64_t SIGNAL_CHECK_NS = 20 * <int64_t>1000000


@cython.final
@cython.no_gc_clear
cdef class Wait(WaiterOwner):
    """The wait for one lookup. Engines make them; dropping the last reference ends the wait."""

    def __init__(self):
        raise TypeError("a Wait is made by BufferCore._wait()")

    def __dealloc__(self):
        self.cancel()
        if self._engine is None or self._engine.has_forgotten(&self._waiter):
            return
        if self._notify is None:
            event_free(&self._woken)

    cdef object deliver(self):
        outcome = self._outcome()
        if outcome is None:
            return None
        if self._judges_age():
            self.cancel()   # since it was judged, another thread may have filed it again
        else:
            self._is_filed = False
        return self._notify(None, outcome) if isinstance(outcome, BaseException) else self._notify(outcome)

    cdef bint _judges_age(self) noexcept:
        return self._policy is not None and self._policy.policy.judges_age

    cdef object _outcome(self):
        try:
            return self._find_outcome()
        except BaseException as error:
            # Whoever inserts has nothing to do with what a program's clock raises.
            if not self._engine.is_of_clock(error):
                raise
            return error

    cdef object _find_outcome(self):
        cdef Query judged
        cdef ClockReading reading
        # What was answered at its creation, or handed over before, is not judged again.
        if self._is_filed and self._judges_age():
            if not self._engine.has_read_clock(&judged, &reading):
                return ValueError(NO_CLOCK)
            # Reading the clock may run code in Python, during which this may have ended.
            if not self._is_filed or not self._engine.judge_waiter(&self._waiter, &reading):
                return None
        elif not load_acquire(&self._waiter.answered):
            return None
        if self._waiter.status.code != STATUS_OK:
            return self._engine.error(&self._waiter.query, self._waiter.status)
        target, source, _ = self._names
        return new_transform_stamped(&self._waiter.answer, self._waiter.stamp_ns, target, source)

    cdef void only_after(self, Wait previous) noexcept:
        cdef const Waiter* before = &previous._waiter
        cdef bint is_answered = load_acquire(&before.answered)
        self._waiter.only_new = is_answered or before.only_new
        self._waiter.previous = before.answer if is_answered else before.previous
        self._waiter.previous_ns = before.stamp_ns if is_answered else before.previous_ns

    cdef int begin(self, Engine engine, tuple names, const Query* query, PolicyObject policy,
                   object notify) except -1:
        cdef Status status
        cdef ClockReading reading
        self._names, self._policy = names, policy
        self._notify = notify
        self._waiter.query = query[0]
        self._waiter.owner = <void*>self
        self._waiter.woken = &self._woken if notify is None else NULL
        if policy is not None and policy.policy.judges_age:
            engine.read_clock(&self._waiter.query, &reading)
        if notify is None and event_init(&self._woken) != 0:
            raise MemoryError
        self._engine, self._is_filed = engine, True
        engine.add_waiter(&self._waiter, &status)
        if status.code == STATUS_OK:
            self._is_filed = False
            return 0
        # With such a limit or name there will never be an answer.
        if status.code == STATUS_BAD_LIMIT:
            pass
        elif name_is_invalid(query.target, query.target_size):
            status.code = STATUS_BAD_TARGET
        elif name_is_invalid(query.source, query.source_size):
            status.code = STATUS_BAD_SOURCE
        elif query.fixed != NULL and name_is_invalid(query.fixed, query.fixed_size):
            status.code = STATUS_BAD_FIXED
        else:
            return 0
        self.cancel()
        raise engine.error(query, status)

    def outcome(self, bint again=False):
        """
        The answer as a new message, or the exception that ends the wait; None: it goes on.

        A wait that judges ages is tried again by what the clock shows now: an outdated answer does not count,
        and an answer that is found here is not delivered otherwise. What ends a wait without an answer is a
        ValueError, if a limit of the policy could never apply; an ExtrapolationException, if the buffer
        refuses the missing data; or what a program's clock raises.

        :param again: also if the answer was delivered before.
        """
        self._is_filed = self._is_filed or (again and self._judges_age())
        return self._outcome()

    def take(self, bint again=False):
        """The answer as a new message, or None; raises the exception that ends the wait, see `outcome`."""
        outcome = self.outcome(again)
        if isinstance(outcome, BaseException):
            raise outcome
        return outcome

    cpdef bint cancel(self) noexcept:
        """End the wait. Returns whether it was pending, that is, not answered and not ended before."""
        # Nothing else says, without the lock, whether an answered one is still in a list: a wake sets
        # `answered` before it adds the waiter to those that are ready.
        cdef bint is_filed = self._is_filed
        self._is_filed = False
        return is_filed and self._engine.remove_waiter(&self._waiter)

    @property
    def must_be_tried(self):
        """
        Whether :meth:`take` must be called regularly.

        It must if it judges ages by a clock that does not report that it was set back, or that it begins.
        """
        return self._judges_age() and self._engine._must_look

    def reason(self):
        """The exception that a lookup would raise now. None: there is an answer, which waits have, too."""
        try:
            return self._engine.reason(&self._waiter.query)
        except BaseException as error:
            if not self._engine.is_of_clock(error):
                raise
            return error

    def is_of_clock(self, error):
        """Whether an exception may come from the code of a program's clock."""
        return self._engine.is_of_clock(error)

    def wait_for(self, int64_t timeout_ns, is_in_vain):
        """
        Sleep, without the GIL, until :meth:`take` returns an answer.

        :param timeout_ns: nanoseconds of steady time.
        :param is_in_vain: called without arguments, at least every 100 ms; True ends the wait.
        :return: the answer, or None. The wait ends in any case, even if a signal handler raises.
        """
        cdef int64_t deadline_ns = monotonic_ns() + timeout_ns
        cdef int64_t check_ns = SIGNAL_CHECK_NS
        cdef int64_t left_ns
        cdef bint is_woken
        try:
            while True:
                answer = self.take()
                if answer is not None:
                    return answer
                left_ns = deadline_ns - monotonic_ns()
                if left_ns <= 0 or self._engine.has_forgotten(&self._waiter) or is_in_vain():
                    return None
                with nogil:
                    is_woken = event_wait(&self._woken, min(left_ns, check_ns))
                PyErr_CheckSignals()
                if not is_woken and check_ns == SIGNAL_CHECK_NS and get_ident() != main_thread().ident:
                    check_ns = WAKE_CHECK_NS
        finally:
            # The thread that has set the event may still use it, and releases the lock after that.
            self.cancel()
