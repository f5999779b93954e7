# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
End what waits once, in one step with its callbacks: a future, a subscription to changes.

This is Cython because no signal handler and no other thread runs between two of its lines that run no code in
Python. So nothing here needs a lock, and nothing has to be repeated after an interrupt. Before Python 3.12,
the collector, and so a finalizer or another thread, may run wherever a container is made, such as a list, a
tuple or a bound method; not where one grows.
"""

import sys

from tf2_py import TimeoutException, TransformException
from tf2_py._internal import log
from tf2_ros_cython import _ros_presence

if _ros_presence.HAS_ROS:
    from tf2_ros._rclpy import wakes_executor

cdef object SYS = sys  # when Python ends, it clears the names of this module before some futures are gone
cdef tuple STATES = ("pending", "queued", "running", "done", "cancelled")


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
            print(f"The following exception was never retrieved: {self._error}", file=SYS.stderr)

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

    The wait for the next one begins when the function has returned. If it finds a transform at once, the
    thread that ran the function calls it again; an executor does other work in between.

    :param begin: begins to wait, with `notify` and `after` of ``BufferCore._wait``.
    :param kept: see `Pending`.
    """

    cdef object _begin, _callback

    def __init__(self, begin, callback, kept):
        self._begin, self._callback, self.kept, self._state = begin, callback, kept, RUNNING
        self.kept[self] = None
        try:
            self.wait = self._begin(notify=self._answered)
            call_all(self._go_on())
        except BaseException:
            self.cancel()   # the program gets nothing to cancel it with
            raise

    def __call__(self):
        if self._state != QUEUED:
            return None
        self._state = RUNNING
        wait = self.wait
        try:
            outcome = wait.outcome(again=True)
            if isinstance(outcome, BaseException):
                self._fail(outcome)
            # None: it has become too old since it arrived, and the wait goes on.
            elif outcome is not None and self._state == RUNNING:
                # Otherwise a thread that was about to deliver it would judge it again, by now with what the
                # function has not got, and the next wait would wait for something else.
                wait.cancel()
                call_back(self._callback, (outcome,))
                if self._state == RUNNING:      # not cancelled meanwhile
                    self.wait = self._begin(notify=self._answered, after=wait)
            return self._go_on()
        except BaseException as error:
            # Of the next wait; otherwise a signal handler has raised it, and nobody would make the next call.
            if not isinstance(error, (TransformException, ValueError)) and not wait.is_of_clock(error):
                self.cancel()
                raise
            self._fail(error)

    cdef object _go_on(self):
        # Until it is PENDING, answers that are delivered are ignored; this takes them.
        wait = self.wait
        if self._state >= DONE:
            self.wait = None    # cancelled meanwhile
            return None
        self._state = PENDING
        return None if wait.outcome() is None else self.end_or_queue()

    def _answered(self, answer, error=None):
        # Of the present wait, or of a former one: the call takes what there is.
        return self.end_or_queue() if error is None else self._fail(error)

    cdef object _fail(self, error):
        # A limit is of a frame that is not a child, or a program's clock raises.
        log.raised(error, "An on_change ends")
        self.cancel()
