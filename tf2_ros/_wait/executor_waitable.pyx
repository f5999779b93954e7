# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Take part in the rounds of rclpy's executors: before one sleeps, and after it wakes.

This is Cython because executors have thousands of rounds a second, and because no signal handler can
interrupt it halfway. What it relies on inside rclpy is tested by tests/ros/test_executor_waitable.py; the
Python part is ``tf2_ros._rclpy``.
"""

cimport cython
from libc.stdint cimport int64_t, uint32_t, uint64_t, uintptr_t

from tf2_py._internal cimport (
    exchange64_seq_cst,
    load64_seq_cst,
    load_seq_cst,
    monotonic_ns,
    store64_seq_cst,
    store_seq_cst,
)
from tf2_ros._rcl cimport (
    RCL_RET_OK,
    rcl_guard_condition_t,
    rcl_trigger_guard_condition,
    rcutils_reset_error,
)
from tf2_ros._process.inbox cimport ROUND_NS, SHORT_ROUND_NS, Observer

from contextlib import suppress

from rclpy.waitable import NumberOfEntities

from tf2_ros._rcl import problem
from tf2_ros._rclpy import has_tasks, is_below_own_loop, waits_for_sets
from tf2_ros._rclpy import wake as wake_executor

cdef extern from "Python.h":
    unsigned long PyThread_get_thread_ident()

# When a sleeping executor wakes for arrivals: never, or in the next round of the receiver thread, or in the
# first one after some steady time.
cdef uint64_t NEVER = 0
cdef uint64_t NEXT_ROUND = 1
# How often messages wake an executor in its own loop, at most. Signal handlers, tasks that poll and errors of
# other threads are handled in its rounds, and programs rely on transforms to cause rounds.
cdef int64_t BUSY_ROUND_NS = 100000000
cdef int64_t IDLE_ROUND_NS = 1000000000     # where it has no tasks
# A loop that has been woken so often, while nothing has read the buffer, is not in a hurry.
cdef int MAX_UNREAD = 50


# Atomic: written by executors, with the GIL, and by threads without it. It exists as long as its object.
#   the executor          wake_at_ns             a round of the receiver thread, if `arrived` is set
#   runs callbacks        NEVER                  does nothing
#   sleeps in user code's
#   call of it            NEXT_ROUND             sets `round_due`, and wakes it
#   sleeps in its loop    when a round is due    from then on as above
# An arrival only sets `arrived`. What wakes the executor resets `wake_at_ns` to NEVER. `is_ready` resets all.
cdef struct ExecutorState:
    uint64_t wake_at_ns     # when an arrival wakes the executor
    uint32_t arrived        # something has arrived that no round of an executor has accounted for
    uint32_t round_due      # the executor was woken for what arrived
    const rcl_guard_condition_t* guard  # wakes it


cdef void _wake(ExecutorState* state) noexcept nogil:
    if rcl_trigger_guard_condition(<rcl_guard_condition_t*>state.guard) != RCL_RET_OK:
        rcutils_reset_error()


@cython.no_gc_clear     # threads without the GIL use the guard condition until this is destroyed
cdef class ExecutorWaitable(Observer):
    """The part of an ``rclpy.waitable.Waitable`` that an executor calls in each of its rounds."""

    cdef ExecutorState state
    cdef object _handle         # keeps the guard condition
    cdef public object calls    # those that are to be made in rounds
    cdef void* _wait_set        # of the executor that went to sleep last, if it has not woken yet
    cdef unsigned long _thread  # of that executor
    cdef int _unread            # how often it was woken since the buffer was read; at most MAX_UNREAD
    cdef int64_t _woken_ns      # steady time of the last round for which it had to wake
    cdef bint _has_displaced    # an executor of another thread, which may sleep
    cdef bint _uses_wait_sets   # no EventsExecutor has had the node

    def __cinit__(self, *_, **__):
        self._uses_wait_sets, self.calls = True, ()

    def set_up(self, guard):
        """
        Let executors have rounds with this object; to be called before anything else.

        :param guard: the guard condition that wakes an executor: a handle, whose ``pointer`` is the address
            of its rcl struct as long as the handle exists.
        """
        self._handle = guard
        if problem() is None:
            self.state.guard = <const rcl_guard_condition_t*><uintptr_t>guard.pointer

    cdef void inserted(self) noexcept nogil:
        store_seq_cst(&self.state.arrived, True)

    cdef void wake_if_due(self) noexcept nogil:
        cdef uint64_t wake_at_ns = load64_seq_cst(&self.state.wake_at_ns)
        if wake_at_ns == NEVER or not load_seq_cst(&self.state.arrived):
            return
        if <uint64_t>monotonic_ns() < wake_at_ns:
            return
        if exchange64_seq_cst(&self.state.wake_at_ns, NEVER) != NEVER:
            store_seq_cst(&self.state.round_due, True)
            _wake(&self.state)

    @property
    def uses_wait_sets(self):
        """Whether no ``EventsExecutor`` has, or has had, the node: it has arrivals reported to itself."""
        executor = self.executor()
        return self._uses_wait_sets and (executor is None or waits_for_sets(executor))

    def executor(self):
        """For subclasses: the executor that has the node, or had it last, or None."""
        raise NotImplementedError

    def yield_to_events_executor(self):
        """For subclasses: have calls made in another way, because no executor waits for the node's sets."""
        raise NotImplementedError

    def __enter__(self):
        """Do nothing, because the guard condition exists as long as this object."""

    def __exit__(self, *_):
        """Do nothing."""

    def get_num_entities(self):
        """One guard condition; none once an ``EventsExecutor``, which refuses them, has had the node."""
        if self._uses_wait_sets and not self.uses_wait_sets:
            self._uses_wait_sets = False
            self.yield_to_events_executor()
        return NumberOfEntities(0, 1) if self._uses_wait_sets else NumberOfEntities()

    def add_to_wait_set(self, wait_set):
        """Prepare for an executor that is about to sleep."""
        cdef bint arrived, is_short
        if not self._uses_wait_sets:
            return
        is_in_own_loop = is_below_own_loop()
        self._has_displaced = self._wait_set != NULL and self._thread != PyThread_get_thread_ident()
        self._wait_set, self._thread = <void*>wait_set, PyThread_get_thread_ident()
        store_seq_cst(&self.state.round_due, False)
        if is_in_own_loop:
            store_seq_cst(&self.state.arrived, False)
            period_ns = BUSY_ROUND_NS if has_tasks(self.executor()) else IDLE_ROUND_NS
            store64_seq_cst(&self.state.wake_at_ns, <uint64_t>monotonic_ns() + <uint64_t>period_ns)
        else:
            # User code called the executor, and continues when something has arrived since its last round;
            # but not for each message, because a round costs as much as ten messages. This stores
            # `wake_at_ns` and then loads `arrived`; an arrival stores `arrived`, and a round of the receiver
            # thread then loads `wake_at_ns`. So at least one of them sees the other.
            store64_seq_cst(&self.state.wake_at_ns, NEXT_ROUND)
            if any([inbox.was_read() for inbox in self.inboxes]):
                self._unread = 0
            is_short = self._unread < MAX_UNREAD
            arrived = load_seq_cst(&self.state.arrived)
            if arrived and monotonic_ns() - self._woken_ns >= (SHORT_ROUND_NS if is_short else ROUND_NS):
                store_seq_cst(&self.state.round_due, True)
            else:
                for inbox in self.inboxes:
                    inbox.await_round(is_short, arrived)
        if self._is_due():
            self.wake()
        wait_set.add_guard_condition(self._handle)

    def is_ready(self, wait_set):
        """Whether something has arrived that the executor had to wake for, or a call must run."""
        if not self._uses_wait_sets:
            return False    # it adds nothing to sets; a timer looks for calls
        if self._wait_set != <void*>wait_set:
            # The node has moved to another executor, which must not miss anything: in rmw_zenoh, a guard
            # condition in two sets leaves both when one of them wakes.
            self._have_prepared_again()
            return False
        self._wait_set = NULL
        due = self._is_due()
        store64_seq_cst(&self.state.wake_at_ns, NEVER)
        if due:
            self._woken_ns, self._unread = monotonic_ns(), min(self._unread + 1, MAX_UNREAD)
            # Otherwise something may have arrived since, for which `add_to_wait_set` looks.
            store_seq_cst(&self.state.round_due, False)
            store_seq_cst(&self.state.arrived, False)
        if self._has_displaced:
            # The node moved to the other executor while this one was gathering: the other must prepare again.
            self._has_displaced = False
            self._have_prepared_again()
        return due

    def take_data(self):
        """Return how many calls there are, because later ones must not delay other callbacks."""
        return len(self.calls)

    def wake(self):
        """Trigger the guard condition."""
        if self.state.guard != NULL:
            _wake(&self.state)
        else:
            with suppress(RuntimeError):    # the context has ended
                self._handle.trigger_guard_condition()

    cdef int _have_prepared_again(self) except -1:
        # Wake the executor that has the node, which then goes to sleep anew.
        executor = self.executor()
        if waits_for_sets(executor):
            wake_executor(executor)
        return 0

    cdef bint _is_due(self):
        return len(self.calls) > 0 or load_seq_cst(&self.state.round_due)
