"""
End waits at their deadlines.

This is Cython because no signal handler runs between two of its lines that run no code in Python.
"""

from libc.stdint cimport INT64_MAX, int64_t

from tf2_py._internal cimport monotonic_ns

import atexit
import os
import sys
import threading
import weakref
from heapq import heapify, heappop, heappush

from tf2_py._internal import log
from tf2_ros._threads import call_logged, running, start_once

# How long a thread without work waits for more. In a busy program, starting a thread takes longer than most
# work.
cdef int64_t LINGER_NS = 1000000000
cdef int64_t NEVER_NS = INT64_MAX

cdef enum:
    FEW = 64    # deadlines; it is not worth removing ended ones from fewer


cdef class Deadlines:
    """
    Calls ``expire()`` of waits at their deadlines, unless they were ``over()``, or collected, before.

    At most one thread does: it starts with the first deadline and ends one second after the last.
    """

    cdef readonly list entries      # a heap of deadline, number and weak reference
    cdef int64_t _added
    cdef Py_ssize_t _sweep_at
    cdef bint _is_stopping
    cdef object _asleep             # released to wake the thread, so that an interrupted caller holds nothing

    def __cinit__(self):
        self.begin_anew()

    def begin_anew(self):
        """Forget thread and deadlines; also for a forked child, which does not have the thread."""
        self.entries, self._sweep_at, self._is_stopping = [], FEW, False
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
        if sys.is_finalizing():     # before Python 3.12, starting a thread would wait for it forever
            raise RuntimeError("cannot start a thread during interpreter shutdown")
        start_once("tf2_ros deadlines", self._run)
        if self.entries and (self.entries[0][1] == number or len(self.entries) > self._sweep_at):
            self._wake()

    def stop(self):
        """End the thread, although deadlines are left."""
        self._is_stopping = True
        self._wake()

    cdef int _wake(self) except -1:
        if self._asleep.locked():
            self._asleep.release()
        return 0

    def _run(self):
        cdef int64_t left_ns
        cdef bint is_woken = True
        cdef dict threads = running     # of this type, so that `pop` makes no bound method
        run = self._run
        while (is_woken or self.entries) and not self._is_stopping:
            self._sweep()
            left_ns = self._expire() - monotonic_ns()
            # What was added meanwhile, and is the first, has released this.
            is_woken = self._asleep.acquire(timeout=max(min(left_ns, LINGER_NS), 0) / 1e9)
        threads.pop(run, None)      # at once, so that what is added from now on starts another thread

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
        cdef list seen, kept
        cdef set numbers
        if len(self.entries) > self._sweep_at:
            seen = list(self.entries)
            numbers = {entry[1] for entry in seen}
            kept = [entry for entry in seen if _pending(entry) is not None]
            # Others were added meanwhile. None is from here on, because no code in Python runs.
            for entry in self.entries:
                if entry[1] not in numbers:
                    kept.append(entry)
            heapify(kept)
            self.entries, self._sweep_at = kept, 2 * len(kept) + FEW
        return 0


cdef object _pending(tuple entry):
    # One that cannot say whether it is over must not keep the others from their ends.
    wait = entry[2]()
    try:
        return None if wait is None or wait.over() else wait
    except Exception as error:
        log.raised(error, "At a deadline")
        return None


# One for the whole process.
deadlines = Deadlines()
atexit.register(deadlines.stop)
os.register_at_fork(after_in_child=deadlines.begin_anew)
