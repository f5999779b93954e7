# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Hand what has ended to whatever runs a node: an executor or an event loop.

This is Cython so that no signal handler runs between taking something from the queue and calling it.
"""

from libc.stdint cimport int64_t

from tf2_py._internal cimport monotonic_ns
from tf2_ros._wait.pending cimport Pending

cdef extern from "Python.h":
    bint Py_IsInitialized()     # False while modules are destroyed

import os
import weakref
from collections import deque
from functools import partial
from threading import get_ident, main_thread

from tf2_py._internal import log
from tf2_ros._nodes.ended_nodes import node_has_ended
from tf2_ros._process.background import check_regularly
from tf2_ros._process.forking import is_inherited, keep_in_children
from tf2_ros._process.threads import callbacks
from tf2_ros._rclpy import context_was_shut_down
from tf2_ros._sources import sources_of
from tf2_ros._wait.pending import call_all

WARN_S = 10.0   # how long calls wait for what runs the node before a warning says so


cdef class CallQueue:
    """
    A node's calls of user code, for waits that have ended: a queue, usually one for a node.

    What ends a wait puts a `Pending` here: an insert of a listener, a timeout, a shutdown. Only what a
    program calls itself runs the code at once: an insert, `cancel`, `set_result` or `set_exception`. Server
    and client also put plain calls, which are dropped without a word. This class promises:

    1. **Order.** Calls are made in the order of :meth:`put`, one at a time.
    2. **Threads.** They are made by what runs the node, as callbacks of subscriptions are. While nothing runs
       the node they wait; after WARN_S, one warning says so.
    3. **Exceptions.** A `Pending` logs each `Exception` of a callback itself. What a call raises nevertheless
       is logged, because later calls and other callbacks of the node do not depend on it; not what a plain
       call raises after the end of the node. In the main thread, what ends a program is raised instead, such
       as a KeyboardInterrupt; the other calls remain.
    4. **Interrupts.** Threads, signal handlers and finalizers may put. No signal handler comes between taking
       a call from the queue and making it. One that raises inside :meth:`put` at most delays the call until
       the next regular check.
    5. **The end.** When the node has ended, which is noticed within two seconds, the calls are dropped, and
       their futures end with a TimeoutException that says why. Futures that are still pending wait on.
    6. **Forks.** In a forked child it is dead: calls are dropped silently.

    :param node: keeps this alive, not the other way round.
    :param runner: a :class:`~tf2_ros._wait.call_runners.Runner`, only for this.
    """

    cdef object __weakref__
    cdef readonly object node       # a weak reference
    cdef readonly object runner
    cdef readonly object calls      # the oldest first
    cdef int64_t _waits_from_ns     # steady time since which the oldest call waits
    cdef object _context
    cdef str _name
    cdef str _why_closed
    cdef bint _has_warned
    cdef object _process            # of the node

    def __init__(self, node, runner):
        self.calls, self.runner, self._why_closed = deque(), runner, ""
        self.node, self._context, self._process = weakref.ref(node), node.context, os.getpid()
        self._name = node.get_fully_qualified_name()
        keep_in_children(node)
        runner.begin(self)
        check_regularly(self)

    def put(self, call):
        """Add a call, or drop it after the end of the node."""
        if not self.calls:
            self._waits_from_ns = monotonic_ns()
        self.calls.append(call)     # first: a signal handler may raise below, where code in Python runs
        if is_inherited(self._process):
            self.calls.clear()      # the node is the parent's
        elif self._why_closed:
            self.drop(self._why_closed)
        else:
            self.runner.wake()

    def hand_over(self, pending):
        """Add what a listener's insert has ended, to its own queue if it has one."""
        (pending.call_queue or self).put(pending)

    def run(self, Py_ssize_t count):
        """Make at most this many calls, the oldest first; for the runner."""
        while count > 0 and self.calls:
            count -= 1
            call = self.calls.popleft()
            try:
                following = call()
                if isinstance(following, Pending):
                    self.put(following)
            except BaseException as error:
                if not isinstance(error, Exception) and get_ident() == main_thread().ident:
                    raise
                # A call of server or client fails where the node ends meanwhile, which needs no words.
                if isinstance(call, Pending) or not self.has_ended():
                    log.raised(error)
            following = call = None
        self._waits_from_ns = monotonic_ns()

    def drop(self, why):
        """Drop the calls; what waits ends, for this reason."""
        while self.calls:
            call = self.calls.popleft()
            if isinstance(call, Pending):
                call.drop(why)

    def close(self, str why not None):
        """Drop the calls, now and from now on, and leave the node; may be called again."""
        self._why_closed = self._why_closed or why
        try:
            self.runner.leave()
        finally:
            self.drop(self._why_closed)

    def __del__(self):
        """Drop the calls, because the node was not destroyed, but collected."""
        # While modules are destroyed, nobody is left to be told, and what is printed fails.
        if self.calls and Py_IsInitialized() and not is_inherited(self._process):
            self.close(f"the node [{self._name}] was collected")

    def has_ended(self):
        """Whether calls are dropped, now or soon."""
        if self._why_closed or is_inherited(self._process):
            return True
        node = self.node()
        return node is None or node_has_ended(node)

    def is_served(self):
        """Whether calls are made soon: an executor or a loop has the node, though a callback may block it."""
        return not self.has_ended() and self.runner.is_running()

    def is_late(self, int64_t waits_from_ns):
        """Whether what has waited for the executor or loop since this steady time is worth a warning."""
        return monotonic_ns() - waits_from_ns > WARN_S * 1e9

    def _tf2_check(self):
        """Drop the calls if the node has ended; warn if they have waited for long."""
        node = self.node()
        if node is None:
            self.close(f"the node [{self._name}] was collected")
        if self._why_closed or node is None:
            self.drop(self._why_closed)     # a signal handler may have raised in `close`
            return
        if node_has_ended(node):
            if context_was_shut_down(self._context):
                self.close(f"the context of the node [{self._name}] was shut down")
                # After a signal, rclpy first wakes its executors and then shuts the contexts down. One that
                # goes to sleep in between would sleep until a message wakes it.
                self.runner.wake()
            else:
                self.close(f"the node [{self._name}] was destroyed")
        elif self.calls:
            self.runner.wake()      # a signal handler may have raised in `put`
            if not self._has_warned and self.is_late(self._waits_from_ns):
                self._has_warned = True
                why = self.runner.why_late(self._name)
                log.logger("tf2_ros").warning(f"Callbacks of tf2 have been waiting for {WARN_S:g} s: {why}")


def call_queue_for(buffer):
    """Find the queue for a buffer: of its latest listener whose node has not ended; None if there is none."""
    for reference in reversed(sources_of(buffer).call_queues):
        found = reference()
        if found is not None and not found.has_ended():
            return found
    return None


def end_for(buffer, pending):
    """Have its own queue, or what runs the node of a buffer's latest listener, end something, as `end_by`."""
    end_by(getattr(pending, "call_queue", None) or call_queue_for(buffer), pending)


def end_by(CallQueue call_queue, pending):
    """Have what runs a node end something; if nothing runs it now, or there is no queue, another thread."""
    if pending is None:
        return
    if call_queue is not None and call_queue.is_served():
        call_queue.put(pending)
    else:
        callbacks.put(partial(call_all, pending))
