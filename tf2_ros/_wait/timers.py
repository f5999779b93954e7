"""End asynchronous waits at their deadlines, in a thread that exists while there are any."""

import heapq
import itertools
import os
import sys
import threading
import time
import traceback
import weakref
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from tf2_py._internal import log

# How long a thread without work waits for more. In a busy program, starting a thread takes longer than most
# work.
LINGER_S = 1.0
FEW = 64  # deadlines; it is not worth removing ended ones from fewer
NEVER_NS = 2**63


def call_logged(call: Callable[[], object], where: str) -> None:
    """Call something, and log what it raises, because no caller would catch it."""
    try:
        call()
    except BaseException:
        log.logger("tf2_ros").error(f"{where}: {traceback.format_exc()}")


class Expiring(Protocol):
    """A wait that has a deadline."""

    def over(self) -> bool:
        """Whether it ended before its deadline."""
        ...

    def expire(self) -> None:
        """The deadline has passed."""


_Entry = tuple[int, int, "weakref.ref[Expiring]"]


class Deadlines:
    """
    Calls ``expire()`` of waits at their deadlines, unless they were over, or collected, before.

    There is at most one thread: it starts with the first deadline and ends LINGER_S after the last. Only it
    touches the heap; others add to a deque, so that a signal handler or a finalizer can do so anywhere.
    """

    def __init__(self) -> None:
        self._order = itertools.count()
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget thread and deadlines; also for a forked child, which does not have the thread."""
        self._added: deque[_Entry] = deque()
        self._heap: list[_Entry] = []
        self._sweep_at = FEW
        self._sleeps_until_ns = 0
        self._claims: dict[None, object] = {}  # at most one, of the thread that runs
        # Released to wake the thread, so that an interrupted caller holds nothing.
        self._asleep = threading.Lock()
        self._asleep.acquire()

    def add(self, deadline_ns: int, wait: Expiring) -> None:
        """
        Call ``wait.expire()`` when ``time.monotonic_ns()`` is ``deadline_ns``; refers to it weakly.

        :raises RuntimeError: no thread can be started; the next call tries again.
        """
        self._added.append((deadline_ns, next(self._order), weakref.ref(wait)))
        if None not in self._claims:
            if sys.is_finalizing():  # before Python 3.12, it would wait for the thread forever
                raise RuntimeError("no thread can be started at the end of the interpreter")
            # Of several that start at once, all but one end at once.
            threading.Thread(target=self._run, name="tf2_ros deadlines", daemon=True).start()
        elif deadline_ns < self._sleeps_until_ns or len(self._added) > FEW:
            with suppress(RuntimeError):  # it is being woken already
                self._asleep.release()

    def entries(self) -> list[_Entry]:
        """All entries that have not been removed yet; for tests."""
        return [*self._added, *self._heap]

    def _run(self) -> None:
        claim = object()
        # Calls of `add` just before the claim was given up relied on it, so it looks again.
        while (self._added or self._heap) and self._claims.setdefault(None, claim) is claim:
            try:
                woken = True
                while woken or self._added or self._heap:
                    woken = self._asleep.acquire(timeout=self._work())
            finally:
                del self._claims[None]

    def _work(self) -> float:
        """End what is due, and return how many seconds to sleep unless woken."""
        self._sleeps_until_ns = 0
        while True:
            self._take_added()
            left_ns = self._expire()
            self._sleeps_until_ns = self._heap[0][0] if self._heap else NEVER_NS
            # First this, then the check; `add` does this in the opposite order.
            if not self._added:
                return min(left_ns / 1e9, LINGER_S)

    def _expire(self) -> int:
        """End all whose deadline has passed; return in how many nanoseconds the next one passes."""
        while self._heap:
            deadline_ns, _, reference = self._heap[0]
            wait = _pending(reference)
            left_ns = deadline_ns - time.monotonic_ns()
            if wait is not None and left_ns > 0:
                return left_ns
            heapq.heappop(self._heap)
            if wait is not None:
                call_logged(wait.expire, "At the end of a timeout")
                del wait  # so that this frame does not keep it alive
            self._take_added()
        return NEVER_NS

    def _take_added(self) -> None:
        with suppress(IndexError):
            while True:
                heapq.heappush(self._heap, self._added.popleft())
        if len(self._heap) >= self._sweep_at:
            # Waits usually end well before their deadline. Their entries would pile up until then.
            self._heap = [entry for entry in self._heap if _pending(entry[2]) is not None]
            heapq.heapify(self._heap)
            self._sweep_at = 2 * len(self._heap) + FEW


def _pending(reference: "weakref.ref[Expiring]") -> Expiring | None:
    wait = reference()
    return None if wait is None or wait.over() else wait


# One for the whole process.
deadlines = Deadlines()
os.register_at_fork(after_in_child=deadlines.begin_anew)
