# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The background thread: with the GIL, it reports what inboxes insert, and ends what is due.

The owners of inboxes register here, because the exit of the interpreter and a fork end inboxes and threads in
a fixed order.
"""

import atexit
import itertools
import logging
import os
import sys
import time
import weakref
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from heapq import heapify, heappop, heappush
from threading import get_ident
from typing import Any, Protocol, TypeAlias

from tf2_py._internal import log
from tf2_py.printable import counted
from tf2_ros._live_objects import LiveObjects
from tf2_ros._process.inbox import INBOXES, Inbox, Inboxes
from tf2_ros._process.threads import call_logged, callbacks, forget_threads, join_threads, start_once

CHECK_NS = 1_500_000_000  # between two regular checks
NEVER_NS = 1 << 62
SHARE_NS = 1_000_000  # for what is due, before reports come first again
FEW = 64  # entries; it is not worth removing ended ones from fewer


class Timer(Protocol):
    """Something that is due at a time."""

    def over(self) -> bool:
        """Whether nothing is left to do."""
        ...

    def expire(self) -> None:
        """Called when it is due; runs no callback of a program, but may read a program's clock."""
        ...


# When it is due, and a number that no other one has.
_Entry: TypeAlias = "tuple[int, int, weakref.ref[Timer]]"


class Background:
    """
    The background thread: it reports what inboxes have inserted, and expires the timers of any object.

    Only the thread touches the heap. Other threads, signal handlers and finalizers append to ``_added``, and
    wake the thread if it would sleep for too long.
    """

    def __init__(self, inboxes: Inboxes = INBOXES) -> None:
        self._inboxes = inboxes
        self.reset()

    def reset(self) -> None:
        """Forget everything; also for a forked child, which does not have the thread."""
        self._heap: list[_Entry] = []
        self._added: deque[_Entry] = deque()
        self._numbers = itertools.count()
        self._thread = 0  # its identifier
        self._sleeps_until_ns = 0  # 0: the thread is awake, and will look at what was added
        self._sweep_at = FEW
        self._checks = _Checks(self)

    @property
    def entries(self) -> list[_Entry]:
        """All that is not due yet, and some of what has ended."""
        return [*self._heap, *self._added]

    def is_here(self) -> bool:
        """Whether this runs in the thread, in which no code of a program may."""
        return get_ident() == self._thread

    def run_elsewhere(self, call: Callable[[], object]) -> bool:
        """In the thread, have the thread for callbacks call this; elsewhere return False."""
        if not self.is_here():
            return False
        with suppress(RuntimeError):  # no thread can be started: what is put next tries again
            callbacks.put(call)
        return True

    def start(self) -> None:
        """
        Start the thread, unless it runs.

        :raises RuntimeError: no thread can be started; the next use tries again.
        """
        if sys.is_finalizing():  # before Python 3.12, starting a thread would wait for it forever
            raise RuntimeError("cannot start a thread during interpreter shutdown")
        start_once("tf2_ros background", self._run)

    def expire_at(self, due_ns: int, timer: Timer) -> None:
        """
        Expire a timer when ``time.monotonic_ns()`` is `due_ns`, unless it was over, or collected, before.

        :raises RuntimeError: no thread can be started; the next use tries again.
        """
        self._added.append((due_ns, next(self._numbers), weakref.ref(timer)))
        self.start()
        # The thread stores until when it sleeps, and then looks at what was added.
        if due_ns < self._sleeps_until_ns or len(self._added) > self._sweep_at:
            self._inboxes.wake_reporting()

    def check_regularly(self, checked: Any) -> None:
        """Call ``_tf2_check()`` every one or two seconds, as long as something else refers to the object."""
        self._checks.add(checked)

    def _run(self) -> None:
        goes_on, self._thread = True, get_ident()
        while goes_on:
            call_logged(self._inboxes.report_next, "In the background thread")
            until_ns = self._expire_due()
            self._sleeps_until_ns = until_ns
            goes_on = self._inboxes.await_report(0 if self._added else until_ns)
            self._sleeps_until_ns = 0

    def _expire_due(self) -> int:
        # For SHARE_NS at most; returns when the next one is due. No variable of `_run` keeps alive what ends.
        self._file_added()
        pause_ns = time.monotonic_ns() + SHARE_NS
        while self._heap:
            due_ns, timer, now_ns = self._heap[0][0], _unless_over(self._heap[0]), time.monotonic_ns()
            if timer is not None and (due_ns > now_ns or now_ns > pause_ns):
                return due_ns
            heappop(self._heap)
            if timer is not None:
                call_logged(timer.expire, "At the end of a timeout")
        return NEVER_NS

    def _file_added(self) -> None:
        while self._added:
            heappush(self._heap, self._added.popleft())
        # Waits usually end well before they are due. Their entries would pile up until then.
        if len(self._heap) > self._sweep_at:
            self._heap = [entry for entry in self._heap if _unless_over(entry) is not None]
            heapify(self._heap)
            self._sweep_at = 2 * len(self._heap) + FEW


def _unless_over(entry: _Entry) -> Timer | None:
    # One that cannot say whether it is over must not keep the others from their ends.
    timer = entry[2]()
    try:
        return None if timer is None or timer.over() else timer
    except Exception as error:
        log.raised(error, "At the end of a timeout")
        return None


class _Checks:
    """The regular checks, which are due again as long as there is anything to check."""

    def __init__(self, background: Background) -> None:
        self._background = weakref.proxy(background)
        self._checked: LiveObjects[Any] = LiveObjects()
        self._is_filed = False

    def add(self, checked: Any) -> None:
        self._checked.add(checked)
        self._file()

    def _file(self) -> None:
        if not self._is_filed:
            self._is_filed = True
            try:
                self._background.expire_at(time.monotonic_ns() + CHECK_NS, self)
            except BaseException as error:
                self._is_filed = False
                if not isinstance(error, RuntimeError):  # without a thread, the next object tries again
                    raise

    def over(self) -> bool:
        return False

    def expire(self) -> None:
        self._is_filed = False  # first: what is added from now on has them filed
        for checked in self._checked:
            call_logged(checked._tf2_check, "In a regular check")
            self._file()


background = Background()
log.run_elsewhere = background.run_elsewhere
check_regularly = background.check_regularly


# The inboxes, and the ends of all: one order for the exit, and one for a fork.


class InboxOwner(Protocol):
    """Decides when an inbox begins and ends."""

    @property
    def inbox(self) -> Inbox: ...

    def stop(self) -> None:
        """End the inbox, for good."""

    def _tf2_check(self) -> None:
        """Called every one or two seconds."""


_owners: LiveObjects[InboxOwner] = LiveObjects()


def add_owner(owner: InboxOwner) -> None:
    """Serve the inbox of an owner, and check the owner regularly."""
    start_once("tf2_ros receiver", INBOXES.drain_when_due)
    background.start()
    _owners.add(owner)
    check_regularly(owner)


@atexit.register
def _stop_all() -> None:
    for owner in _owners:
        call_logged(owner.stop, "During interpreter shutdown")
    INBOXES.stop()
    callbacks.stop()
    join_threads()


def _after_fork_in_child() -> None:
    INBOXES.reset()
    forget_threads()
    background.reset()
    lost = sum([owner.inbox.leave_to_parent() for owner in _owners])
    _owners.clear()
    if lost:
        # Not logged through ROS, whose locks another thread may have held.
        logging.getLogger("tf2_ros").warning(
            f"Process {os.getpid()} was forked from a process with {counted(lost, 'listener')}. Inherited "
            "objects receive nothing: spawn the process instead of forking it, or create new listeners after "
            "the fork."
        )


os.register_at_fork(after_in_child=_after_fork_in_child)
