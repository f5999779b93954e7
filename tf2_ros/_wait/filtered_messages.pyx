# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The messages of a filter, and what it calls and counts when one of them ends.

See :mod:`tf2_ros._wait.pending` for why this is Cython.
"""

from libc.stdint cimport int64_t

from tf2_ros._wait.pending cimport CANCELLED, DONE, Pending, call_back

import weakref
from collections import OrderedDict

from tf2_py import BufferCore, ExtrapolationException
from tf2_ros._process.background import background
from tf2_ros._sources import asks_program
from tf2_ros._wait.call_queue import end_by

PASSED, CLEARED = "passed", "cleared"   # what became of a message that was not dropped


cdef class FilterCalls:
    """
    What a filter calls and counts.

    :param reasons: an enum, whose members say why a message is dropped.
    """

    cdef readonly dict callbacks            # by a key: a function, and its further arguments
    cdef readonly dict failure_callbacks    # likewise, and whether it takes a text
    cdef readonly object waiting            # the messages that wait, the oldest first
    cdef readonly Py_ssize_t dropped_in_a_row
    cdef dict _ended            # how many have ended in which way
    cdef tuple _streams         # weak references; replaced, never changed, because any thread reads it
    cdef object _reasons

    def __init__(self, reasons):
        self.callbacks, self.failure_callbacks, self.waiting = {}, {}, OrderedDict()
        self._ended, self._streams = dict.fromkeys((PASSED, CLEARED, *reasons), 0), ()
        self._reasons = reasons

    def wants_text(self):
        """Whether a callback takes a text about why a message is dropped."""
        return any([takes_text for _, _, takes_text in self.failure_callbacks.values()])

    def refused(self, error):
        """The reason to drop a message whose wait has ended with this error, and a text."""
        # Else a limit is of a frame that is not a child, or a program's clock raises.
        is_too_old = isinstance(error, ExtrapolationException)
        return self._reasons.OUT_THE_BACK if is_too_old else self._reasons.NO_TRANSFORM_FOUND, str(error)

    def oldest(self):
        """The oldest message that waits, or None, in one step; a dict would pass over all removed ones."""
        for queued in self.waiting:
            return queued
        return None

    def add_stream(self, stream):
        """Pass messages on to an iteration, too, as long as something else refers to it."""
        self._streams = (*map(weakref.ref, self.streams()), weakref.ref(stream))

    def streams(self):
        """The iterations that exist."""
        streams = [reference() for reference in self._streams]
        return [stream for stream in streams if stream is not None]

    def statistics(self):
        """How many messages have ended in which way, and wait."""
        ended, waiting = self._ended.copy(), len(self.waiting)
        return {
            "received": sum(ended.values()) + waiting,
            "passed": ended[PASSED],
            "dropped": {reason.value: ended[reason] for reason in self._reasons},
            "cleared": ended[CLEARED],
            "waiting": waiting,
        }

    cdef int _pass_on(self, message, transform) except -1:
        self._ended[PASSED] += 1
        self.dropped_in_a_row = 0
        for reference in self._streams:
            stream = reference()
            if stream is not None:
                stream.items.append((message, transform))
                stream.arrival.end()
        for callback, more in list(self.callbacks.values()):
            call_back(callback, (message, *more))
        return 0

    cdef int _drop(self, message, reason, text) except -1:
        self._ended[reason] += 1
        self.dropped_in_a_row += 1
        for callback, more, takes_text in list(self.failure_callbacks.values()):
            texts = (text or "",) if takes_text else ()
            call_back(callback, (message, reason, *texts, *more))
        return 0


cdef class WaitsForAll:
    """
    The waits for several transforms, of which all are needed; it has the methods of a Wait.

    :param count: how many there will be; until then it has no answer.
    """

    cdef list _waits
    cdef Py_ssize_t _count

    def __init__(self, Py_ssize_t count):
        self._waits, self._count = [], count

    def add(self, wait):
        """Add one."""
        self._waits.append(wait)

    def outcome(self):
        """
        The first answer, if all are available; or the first exception that ends a wait. A wait keeps its
        answer, unless it has become too old meanwhile.
        """
        cdef list outcomes = [wait.outcome(again=True) for wait in self._waits]
        for one in outcomes:
            if isinstance(one, BaseException):
                return one
        is_complete = len(outcomes) == self._count and all([one is not None for one in outcomes])
        return outcomes[0] if is_complete else None

    def reason(self):
        """The exception of the first lookup without an answer, or None."""
        for wait in self._waits:
            outcome = wait.outcome()
            if outcome is None:
                return wait.reason()
            if isinstance(outcome, BaseException):
                return outcome
        return None

    def cancel(self):
        """End all."""
        for wait in self._waits:
            wait.cancel()


cdef class FilteredMessage(Pending):
    """
    A message that waits in a filter. Its result is a transform, or the reason why it is dropped; then its
    error is a text about that, or None.

    It waits for each transform that it needs, from the beginning. As in tf2, what an insert has answered
    stays the answer, although the buffer may have lost that data when the last one is answered.

    :param frame: of its header, without a leading slash.
    :param outcome: called with this, and a reason to drop it if it lacks a transform, or None: returns its
        result and error. Without a reason the result may be None, and it waits on.
    :param warn: called with this, the reason and the text after it was dropped.
    """

    cdef readonly object message
    cdef readonly str frame
    cdef readonly int64_t stamp_ns
    cdef FilterCalls _calls
    cdef object _outcome, _warn, _buffer

    def __init__(self, FilterCalls calls not None, call_queue, message, str frame, int64_t stamp_ns, outcome,
                 warn):
        self.message, self.frame, self.stamp_ns = message, frame, stamp_ns
        self._calls, self._outcome, self._warn = calls, outcome, warn
        self.call_queue, self.kept = call_queue, calls.waiting

    def at_once(self, buffer, list needed, policy):
        """Its transform, if all that it needs are available; otherwise None. The arguments: see `begin`."""
        first = None
        for frame, ns in needed:
            answer = BufferCore._tf2_look_up(buffer, frame, self.frame, ns, None, None, policy, True)
            if answer is None:
                return None
            first = answer if first is None else first
        return first

    def begin(self, buffer, list needed, policy):
        """
        Begin to wait.

        :param needed: of each transform that it needs, the target frame and the time in nanoseconds. The
            first one is its result.
        :param policy: of ``policy_of``.
        """
        cdef WaitsForAll several = None
        self._buffer = buffer
        if len(needed) > 1:
            several = self.wait = WaitsForAll(len(needed))
        for frame, ns in needed:
            wait = BufferCore._wait(
                buffer, frame, self.frame, ns, notify=self.answered, policy=policy, until_refused=True)
            if self._state >= DONE:
                wait.cancel()   # another thread has ended it meanwhile
            elif several is not None:
                several.add(wait)
            else:
                self.wait = wait

    def answered(self, answer, error=None):
        """Pass, unless the message lacks another transform; with an error, drop it."""
        if error is not None:
            answer, error = self._calls.refused(error)
        elif isinstance(self.wait, WaitsForAll):
            answer, error = self._outcome(self, None)
        return None if answer is None else self.end_or_queue(answer, error)

    def outcome(self):
        """
        Its transform if all are available, also those whose answers are being delivered; the exception that
        ends its wait; or None.
        """
        return None if self.wait is None else self.wait.outcome()

    def lack(self):
        """Why it does not pass now, in the words of a lookup; "": it does, or does not wait."""
        error = None if self.wait is None else self.wait.reason()
        return "" if error is None else str(error)

    def expire(self):
        """At the timeout: drop the message; in the executor that has the node, if one does."""
        if asks_program(self._buffer) and background.run_elsewhere(self.expire):
            return
        end_by(self.call_queue, self.end_or_queue(*self._outcome(self, self._calls._reasons.TIMEOUT)))

    cdef bint _runs_user_code(self) except -1:
        return bool(self._calls.callbacks) or bool(self._calls.failure_callbacks)

    cdef int _call_back(self) except -1:
        if self._state == CANCELLED:
            self._calls._ended[CLEARED] += 1
        elif isinstance(self._result, self._calls._reasons):
            self._calls._drop(self.message, self._result, self._error)
            self._warn(self, self._result, self._error)
        else:
            self._calls._pass_on(self.message, self._result)
        return 0
