# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
End what waits once, in one step with its callbacks: a future, a subscription to changes.

This is Cython because no signal handler and no other thread runs between two of its lines that run no code in
Python. So nothing here needs a lock, and nothing has to be repeated after an interrupt. Before Python 3.12,
the collector, and so a finalizer or another thread, may run wherever a container is made, such as a list, a
tuple or a bound method; not where one grows.
"""

from tf2_py._internal cimport Engine

import sys
from functools import partial

from tf2_py import BufferCore, TimeoutException, TransformException
from tf2_py._internal import log
from tf2_ros_cython import _ros_presence

if _ros_presence.HAS_ROS:
    from tf2_ros._rclpy import wakes_executor

cdef tuple STATES = ("pending", "queued", "done", "cancelled")


cdef class Pending:
    """
    What ends once, with its callbacks. The first outcome counts; only `cancel` and `drop` replace a queued
    one.

    It is called to end it with the outcome that is queued. The call returns what has to be called next, after
    other work, or None.
    """

    def __cinit__(self, *_, **__):
        self.kept = {}

    @property
    def state(self):
        """A word for its state."""
        return STATES[self._state]

    def over(self):
        """Whether it has an outcome, so that no timeout ends it."""
        return self._state != PENDING

    def has_ended(self):
        """Whether it has an outcome that is visible."""
        return self._state >= DONE

    def end(self, result=None, error=None):
        """End with this outcome, or with the one that is queued, and run the callbacks in this thread."""
        if self.end_or_queue(result, error) is not None or self._state == QUEUED:
            self._end(DONE)

    def end_or_queue(self, result=None, error=None):
        """
        End with this outcome, unless it has one; if that runs user code, only note it.

        :return: what has to be called in that case.
        """
        if self._state == PENDING:
            self._result, self._error = result, error
            if self._runs_user_code():
                self._state = QUEUED
                return self
            self._end(DONE)
        return None

    def __call__(self):
        if self._state == QUEUED:
            self._end(DONE)

    def cancel(self):
        """End the wait, or the calls of a subscription; later calls do nothing."""
        if self._state < DONE:
            self._end(CANCELLED)

    def drop(self, why):
        """End a queued one without its callbacks, because nothing can run them any more."""
        if self._state == QUEUED:
            self._end(CANCELLED)

    cdef int _end(self, State state) except -1:
        wait = self.wait    # until `self` no longer refers to it: its end may run finalizers, see `drop`
        self._state = state
        self.kept.pop(self, None)
        if wait is not None:
            wait.cancel()
        self._call_back()
        self.wait = None
        return 0

    cdef bint _runs_user_code(self) except -1:
        return True

    cdef int _call_back(self) except -1:
        return 0


def call_all(call):
    """Call this, what that returns, and so on; for a thread that has no other work."""
    while call is not None:
        call = call()


def end_referred(reference, answer, error=None):
    """End what a weak reference refers to, if it exists, with the answer that it waits for, or an error."""
    pending = reference()
    return None if pending is None else pending.end_or_queue(answer, error)


cdef int call_back(callback, tuple arguments) except -1:
    try:
        callback(*arguments)
    except Exception as error:
        log.raised(error)
    return 0


class Waker:
    """The done callback of a future that only wakes whatever awaits it, and may be called several times."""


cdef bint _only_wakes(callback) except -1:
    # Whether a done callback runs no user code: ours, or one by which an executor wakes itself.
    return isinstance(callback, Waker) or (_ros_presence.HAS_ROS and wakes_executor(callback))


cdef class PendingFuture(Pending):
    """The part of a future that ends it; see rclpy's Future."""

    cdef readonly list done_callbacks   # those of the program
    cdef readonly list wakers           # the others, see `_only_wakes`
    cdef bint _is_fetched

    def __cinit__(self, *_, **__):
        self.done_callbacks, self.wakers = [], []

    def __del__(self):
        if self._state == DONE and self._error is not None and not self._is_fetched:
            print(f"The following exception was never retrieved: {self._error}", file=sys.stderr)

    def done(self):
        """Whether it has a result or an exception."""
        return self._state == DONE

    def cancelled(self):
        """Whether it was cancelled."""
        return self._state == CANCELLED

    def result(self):
        """The result, or raise the exception. None while there is neither, as rclpy's."""
        error = self.exception()
        if error is not None:
            raise error
        return self._result if self._state == DONE else None

    def exception(self):
        """The exception, or None."""
        self._is_fetched = True
        return self._error if self._state == DONE else None

    def set_result(self, result):
        """End with this result, or with the outcome that is queued, see `end`."""
        self.end(result)

    def set_exception(self, exception):
        """End with this exception, or with the outcome that is queued, see `end`."""
        self.end(None, exception)

    def add_done_callback(self, callback):
        """Add a callback, which keeps the future alive unless it only wakes; after the end, call it."""
        cdef bint only_wakes = _only_wakes(callback)    # this may run other threads
        if self._state >= DONE:
            callback(self)
        elif only_wakes:
            self.wakers.append(callback)
        else:
            self.done_callbacks.append(callback)
            self.kept[self] = None

    def remove_done_callback(self, callback):
        """Remove a callback; whether it had been added."""
        cdef list callbacks = self.wakers if _only_wakes(callback) else self.done_callbacks
        try:
            callbacks.remove(callback)
        except ValueError:
            return False
        if not self.done_callbacks:
            self.kept.pop(self, None)
        return True

    def drop(self, why):
        error = TimeoutException(f"The callbacks of this wait were dropped, because {why}")
        none = []
        if self._state == QUEUED:     # only now: what is made above may run another thread
            # Cython frees the old value of an attribute before it stores the new one, and a finalizer that
            # runs then may end this again. So these are kept until this has ended.
            kept = self.done_callbacks, self._result
            self.done_callbacks = none
            self._result, self._error = None, error
            self._end(DONE)
            del kept

    cdef bint _runs_user_code(self) except -1:
        return len(self.done_callbacks) > 0

    cdef int _call_back(self) except -1:
        # Wakers come last, so that whatever awaits the future finds that the program's callbacks have run.
        cdef list callbacks = self.done_callbacks
        cdef list wakers = self.wakers
        self.done_callbacks, self.wakers = [], []
        try:
            for callback in callbacks:
                call_back(callback, (self,))
        finally:
            for waker in wakers:
                call_back(waker, (self,))
        return 0


cdef class ChangeSubscription(Pending):
    """
    Calls a function with each transform between two frames that differs from the previous one.

    While the function runs, this already waits for the next transform. If that arrives meanwhile, the thread
    that runs the function calls it again afterwards; an executor does other work in between.

    :param policy: of ``policy_of``.
    """

    cdef object _buffer, _callback, _policy
    cdef tuple _frames
    cdef bint _is_running, _is_due
    cdef unsigned long long _number     # of the present wait

    def __init__(self, buffer, target_frame, source_frame, callback, policy):
        self._buffer, self._frames, self._policy = buffer, (target_frame, source_frame), policy
        self._callback, self.kept = callback, buffer._tf2_kept
        self.kept[self] = None
        try:
            self._wait_for_next()
            call_all(self)
        except BaseException:
            self.cancel()   # the program gets nothing to cancel it with
            raise

    def __call__(self):
        self._is_due = True
        if self._state != QUEUED or self._is_running:
            return None
        self._is_due, self._is_running = False, True
        self._result, self._state = None, PENDING
        try:
            result = self.wait.take(again=True)
            if result is not None:      # else it has become too old since it arrived, and the wait goes on
                self._wait_for_next()
                if self._state != CANCELLED:    # else the program has cancelled meanwhile
                    call_back(self._callback, (result,))
        except BaseException as error:
            if not self._ends_with(error):
                self.cancel()   # nobody would make the next call
                raise
            self._fail(error)
        finally:
            self._is_running = False
        return self if self._is_due and self._state == QUEUED else None

    def _answered(self, unsigned long long number, answer, error=None):
        # The answer of a former wait, which another thread had begun to deliver, was taken from the wait.
        if number != self._number:
            return None
        return self.end_or_queue(answer) if error is None else self._fail(error)

    cdef bint _ends_with(self, error) except -1:
        # Otherwise a signal handler has raised it.
        cdef Engine engine = self._buffer
        return isinstance(error, (TransformException, ValueError)) or engine.is_of_clock(error)

    cdef object _fail(self, error):
        # A limit is of a frame that is not a child, or a program's clock raises.
        log.raised(error, "An on_change ends")
        self.cancel()

    cdef int _wait_for_next(self) except -1:
        self._number += 1
        notify = partial(self._answered, self._number)
        self.wait = BufferCore._wait(
            self._buffer, *self._frames, 0, notify=notify, policy=self._policy, after=self.wait)
        answer = self.wait.take()
        if self._state >= DONE:
            self.wait = None    # another thread has cancelled this meanwhile
        elif answer is not None:
            self.end_or_queue(answer)
            self._is_due = True
        return 0
