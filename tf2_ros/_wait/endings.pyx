"""
End futures, messages of filters and subscriptions to changes: each in one step with its callbacks, and at its
deadline.

This is Cython because no signal handler and no other thread runs between two of its lines that run no code in
Python. So nothing here needs a lock, and nothing has to be repeated after an interrupt.
"""

from libc.stdint cimport INT64_MAX, int64_t

from tf2_py._internal cimport monotonic_ns

import os
import sys
import threading
import traceback
import weakref
from _thread import start_new_thread
from heapq import heappop, heappush
from types import FunctionType

from tf2_py import BufferCore, TimeoutException
from tf2_py._internal import log

PASSED, CLEARED = "passed", "cleared"   # what became of a message that was not dropped

cdef enum:
    TRIES = 10      # a second signal during a call that only wakes something is rare already


# The life of a future, from the first to one of the last two.
cdef enum State:
    PENDING
    QUEUED      # it has an outcome, which is not visible; what runs its callbacks will end it with them
    DONE
    CANCELLED

cdef tuple STATES = ("pending", "queued", "done", "cancelled")


cdef class Ending:
    """
    What ends once, with its callbacks. The first outcome counts, but cancelling replaces one that is queued.

    It is called to end it with the outcome that is queued.
    """

    cdef object __weakref__
    cdef State _state
    cdef object _result, _error
    cdef public object wait     # for what it lacks, with the buffer; None: for nothing of a buffer
    cdef public object kept     # a dict: the owner's references to what nothing else may refer to
    cdef readonly object queue  # the CallbackQueue that must call it; None: of what received the transform

    def __cinit__(self, *_, **__):
        self.kept = {}

    @property
    def state(self):
        """A word for its state."""
        return STATES[self._state]

    def over(self):
        """Whether it has an outcome, so that no deadline ends it."""
        return self._state != PENDING

    def has_ended(self):
        """Whether it has an outcome that is visible."""
        return self._state >= DONE

    def end(self, result=None, error=None):
        """End with this outcome, unless it has one, and run the callbacks in this thread."""
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
        """End the wait; without effect if it has ended."""
        if self._state < DONE:
            self._end(CANCELLED)

    def drop(self, why):
        """End a queued one without its callbacks, because nothing can run them any more."""
        if self._state == QUEUED:
            self._end(CANCELLED)

    cdef int _end(self, State state) except -1:
        cdef list errors = []   # making it may run a finalizer, which may end this
        if self._state >= DONE:
            return 0
        self._state = state
        self.kept.pop(self, None)
        if self.wait is not None:
            self.wait.cancel()
        self._call_back(errors)
        self.wait = None
        if errors:
            raise errors[0]
        return 0

    # For subclasses.

    cdef bint _runs_user_code(self) except -1:
        return True

    cdef int _call_back(self, list errors) except -1:
        # What the callbacks raise is added to the errors, the first of which is raised after the last one.
        return 0


def notify(reference, answer):
    """End what a weak reference refers to, if it exists, with the answer that it waits for."""
    ending = reference()
    return None if ending is None else ending.end_or_queue(answer)


class Waker:
    """The done callback of a future that only wakes whatever awaits it, and may be called several times."""


cpdef bint only_wakes(callback):
    """
    Whether a done callback runs no user code: ours, or one by which an executor wakes itself.

    Assumes that those are functions of ``rclpy.executors``. Otherwise they are treated as a program's.
    """
    if isinstance(callback, Waker):
        return True
    return isinstance(callback, FunctionType) and callback.__module__ == "rclpy.executors"


cdef class FutureEnding(Ending):
    """The part of a future that ends it; see rclpy's Future."""

    cdef readonly list done_callbacks   # those of the program
    cdef readonly list wakers           # those that only wake
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
        """End with this result, unless it has an outcome."""
        self.end(result)

    def set_exception(self, exception):
        """End with this exception, unless it has an outcome."""
        self.end(None, exception)

    def add_done_callback(self, callback):
        """Add a callback, which keeps the future alive unless it only wakes; after the end, call it."""
        if self._state >= DONE:
            callback(self)
        elif only_wakes(callback):
            self.wakers.append(callback)
        else:
            self.done_callbacks.append(callback)
            self.kept[self] = None

    def remove_done_callback(self, callback):
        """Remove a callback; whether it had been added."""
        cdef list callbacks = self.wakers if only_wakes(callback) else self.done_callbacks
        try:
            callbacks.remove(callback)
        except ValueError:
            return False
        if not self.done_callbacks:
            self.kept.pop(self, None)
        return True

    def drop(self, why):
        error = TimeoutException(f"The callbacks of this wait were dropped, because {why}")
        if self._state == QUEUED:
            self.done_callbacks = []
            self._result, self._error = None, error
            self._end(DONE)

    cdef bint _runs_user_code(self) except -1:
        return len(self.done_callbacks) > 0

    cdef int _call_back(self, list errors) except -1:
        # What only wakes comes last, so that whatever awaits the future finds that the program's callbacks
        # have run; it is called again if a signal handler has cut it short.
        cdef list callbacks = self.done_callbacks
        cdef list wakers = self.wakers
        self.done_callbacks, self.wakers = [], []
        for callback in callbacks:
            _call(callback, (self,), 1, errors)
        for waker in wakers:
            _call(waker, (self,), TRIES, errors)
        return 0


def log_error(error, where="In a callback"):
    """Report an exception with its traceback."""
    log.logger("tf2_ros").error(f"{where}: {''.join(traceback.format_exception(error))}")


cdef int _call(callback, tuple arguments, int tries, list errors) except -1:
    # An `Exception` of a callback is logged; another one is added to the errors.
    error = None
    while tries > 0:
        tries -= 1
        try:
            callback(*arguments)
            break
        except BaseException as raised:
            error = raised
    if isinstance(error, Exception):
        try:
            log_error(error)
        except BaseException as raised:
            errors.append(raised)
    elif error is not None:
        errors.append(error)
    return 0


cdef class QueuedMessage(Ending):
    """
    A message that waits in a MessageFilter. Its result is a transform, or the reason why it is dropped.

    :param frame: of its header, without a leading slash.
    """

    cdef readonly object message
    cdef readonly str frame
    cdef readonly int64_t stamp_ns
    cdef object _filter

    def __init__(self, filter, message, str frame, int64_t stamp_ns):
        self.message, self.frame, self.stamp_ns = message, frame, stamp_ns
        self._filter, self.queue, self.kept = filter, filter._queue, filter._waiting

    def waits_for(self, wait):
        """Note what it waits for, unless it has an outcome."""
        if self._state == PENDING:
            self.wait = wait

    def answered(self, answer):
        """Pass, unless the message lacks another transform. If it is interrupted, the engine repeats it."""
        outcome = self._filter._look_up(self)
        return None if outcome is None else self.end_or_queue(outcome)

    def expire(self):
        """Drop the message, because its timeout has passed."""
        self._filter._expire(self)

    cdef bint _runs_user_code(self) except -1:
        return bool(self._filter.callbacks) or bool(self._filter._failure_callbacks)

    cdef int _call_back(self, list errors) except -1:
        cdef tuple given
        filter, outcome = self._filter, self._result
        if self._state == CANCELLED:
            filter._ended[CLEARED] += 1
            return 0
        if isinstance(outcome, str):
            filter._ended[outcome] += 1
            callbacks, given = filter._failure_callbacks, (self.message, outcome)
        else:
            filter._ended[PASSED] += 1
            callbacks, given = filter.callbacks, (self.message,)
            for reference in filter._streams:
                stream = reference()
                if stream is not None:
                    stream.items.append((self.message, outcome))
                    try:
                        stream.arrival.end()
                    except BaseException as raised:
                        errors.append(raised)
        for callback, more in list(callbacks.values()):
            _call(callback, (*given, *more), 1, errors)
        _call(filter._warn_of_drops, (self, outcome), 1, errors)
        return 0


def first_key(mapping):
    """The first key of an OrderedDict, or None, in one step; a dict would pass over all removed ones."""
    for key in mapping:
        return key
    return None


cdef class ChangeSubscription(Ending):
    """
    Calls a function with each transform between two frames that differs from the previous one.

    It waits for the next one during each call. A thread that is to deliver this one meanwhile leaves it to
    the thread that calls; an executor comes back to it after other work.
    """

    cdef object _buffer, _callback
    cdef tuple _frames
    cdef bint _is_running, _is_due

    def __init__(self, buffer, target_frame, source_frame, callback):
        self._buffer, self._frames = buffer, (target_frame, source_frame)
        self._callback, self.kept = callback, buffer._tf2_kept
        self.kept[self] = None
        try:
            self._wait_for_next()
            self()
        except BaseException:
            self.cancel()   # the program gets nothing to cancel it with
            raise

    def __call__(self):
        cdef list errors = []
        self._is_due = True
        while self._is_due and self._state == QUEUED and not self._is_running:
            self._is_due, self._is_running = False, True
            result, self._result, self._state = self._result, None, PENDING
            try:
                self._wait_for_next()
            except BaseException as raised:     # there is no memory
                errors.append(raised)
                self.cancel()
            _call(self._callback, (result,), 1, errors)
            self._is_running = False
        if errors:
            raise errors[0]

    cdef int _wait_for_next(self) except -1:
        self.wait = BufferCore._wait(
            self._buffer, *self._frames, 0, notify=self.end_or_queue, after=self.wait
        )
        answer = self.wait.answer
        if self._state >= DONE:
            self.wait = None    # another thread has cancelled this meanwhile
        elif answer is not None:
            self.end_or_queue(answer)
            self._is_due = True
        return 0


# Deadlines.

# How long a thread without work waits for more. In a busy program, starting a thread takes longer than most
# work.
cdef int64_t LINGER_NS = 1000000000
cdef int64_t NEVER_NS = INT64_MAX

cdef enum:
    FEW = 64    # deadlines; it is not worth removing ended ones from fewer


def call_logged(call, str where):
    """Call something, and log what it raises, because no caller would catch it."""
    try:
        call()
    except BaseException as error:
        log_error(error, where)


cdef class Deadlines:
    """
    Calls ``expire()`` of waits at their deadlines, unless they were ``over()``, or collected, before.

    There is at most one thread: it starts with the first deadline and ends one second after the last.
    """

    cdef readonly list entries      # a heap of deadline, number and weak reference
    cdef int64_t _added
    cdef Py_ssize_t _sweep_at
    cdef bint _has_thread
    cdef object _asleep             # released to wake the thread, so that an interrupted caller holds nothing

    def __cinit__(self):
        self.begin_anew()

    def begin_anew(self):
        """Forget thread and deadlines; also for a forked child, which does not have the thread."""
        self.entries, self._sweep_at, self._has_thread = [], FEW, False
        self._asleep = threading.Lock()
        self._asleep.acquire()

    def add(self, int64_t deadline_ns, wait):
        """
        Call ``wait.expire()`` when ``time.monotonic_ns()`` is ``deadline_ns``; refers to it weakly.

        :raises RuntimeError: no thread can be started; the next call tries again.
        """
        cdef int64_t number = self._added + 1
        self._added = number
        heappush(self.entries, (deadline_ns, number, weakref.ref(wait)))
        if not self._has_thread:
            if sys.is_finalizing():     # before Python 3.12, it would wait for the thread forever
                raise RuntimeError("no thread can be started at the end of the interpreter")
            self._has_thread = True
            try:
                start_new_thread(self._start, ())
            except BaseException:
                self._has_thread = False
                raise
        elif self.entries[0][1] == number or len(self.entries) > self._sweep_at:
            if self._asleep.locked():
                self._asleep.release()

    def _start(self):
        # In a thread of its own, where no signal handler runs. `Thread.start` waits for the new thread in
        # Python: what a handler raises there surfaces as an error of a lock, or the new thread waits forever.
        try:
            threading.Thread(target=self._run, name="tf2_ros deadlines", daemon=True).start()
        except RuntimeError:    # this thread could be started, another one cannot
            self._run()

    def _run(self):
        cdef int64_t left_ns
        cdef bint is_woken = True
        try:
            while is_woken or self.entries:
                self._sweep()
                left_ns = self._expire() - monotonic_ns()
                # What was added meanwhile, and is the first, has released this.
                is_woken = self._asleep.acquire(timeout=max(min(left_ns, LINGER_NS), 0) / 1e9)
        finally:
            self._has_thread = False

    cdef int64_t _expire(self) except -1:
        # End all whose deadline has passed; return when the next one passes.
        while self.entries:
            entry = heappop(self.entries)
            wait = _pending(entry)
            if wait is None:
                continue
            if entry[0] > monotonic_ns():
                heappush(self.entries, entry)
                return entry[0]
            call_logged(wait.expire, "At the end of a timeout")
        return NEVER_NS

    cdef int _sweep(self) except -1:
        # Waits usually end well before their deadline. Their entries would pile up until then.
        cdef list entries
        if len(self.entries) > self._sweep_at:
            entries, self.entries = self.entries, []
            for entry in entries:
                if _pending(entry) is not None:
                    heappush(self.entries, entry)
            self._sweep_at = 2 * len(self.entries) + FEW
        return 0


cdef object _pending(tuple entry):
    wait = entry[2]()
    return None if wait is None or wait.over() else wait


# One for the whole process.
deadlines = Deadlines()
os.register_at_fork(after_in_child=deadlines.begin_anew)
