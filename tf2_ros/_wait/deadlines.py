"""Owns the one thread of the process that ends asynchronous waits at their deadlines."""

import heapq
import itertools
import threading
import time
import weakref
from collections.abc import Callable
from typing import Protocol

from tf2_ros._forking import LOCK
from tf2_ros._wait.worker import Worker

__all__ = ["Deadlines", "Expiring", "deadlines"]

FEW = 64  # entries; fewer are not worth sweeping
RECHECK_S = 1.0  # how long the thread may outlive the last wait, if that ended before its deadline


class Expiring(Protocol):
    """A wait that has a deadline."""

    def over(self) -> bool:
        """Whether it ended before its deadline."""
        ...

    def expire(self) -> None:
        """The deadline has passed."""


class Deadlines(Worker):
    """
    Calls ``expire()`` of waits at their deadlines, unless they were over, or collected, before.

    The thread starts with the first deadline and ends when none is left.
    """

    def __init__(self) -> None:
        self._order = itertools.count()
        super().__init__("tf2_ros deadlines", "At the end of a timeout")

    def after_fork(self) -> None:
        """Begin anew: the deadlines of before the fork are the parent's."""
        super().after_fork()
        self._changed = threading.Condition(LOCK)
        self._heap: list[tuple[int, int, weakref.ref[Expiring]]] = []
        self._sweep_at = FEW

    def add(self, deadline_ns: int, wait: Expiring) -> None:
        """Call ``wait.expire()`` when ``time.monotonic_ns()`` is ``deadline_ns``; refers to it weakly."""
        entry = (deadline_ns, next(self._order), weakref.ref(wait))
        with self._changed:
            heapq.heappush(self._heap, entry)
            if len(self._heap) >= self._sweep_at:
                self._sweep()
            starting = self._new_thread()
            if starting is None and self._heap[0] is entry:
                self._changed.notify()
        self._start(starting)

    def _sweep(self) -> None:
        # Waits usually end well before their deadline; without this their entries would pile up until then.
        self._heap = [entry for entry in self._heap if _pending(entry[2]) is not None]
        heapq.heapify(self._heap)
        self._sweep_at = 2 * len(self._heap) + FEW

    def _next(self) -> Callable[[], None] | None:
        with self._changed:
            while self._heap:
                deadline_ns, _, reference = self._heap[0]
                wait = _pending(reference)
                left_ns = deadline_ns - time.monotonic_ns()
                if wait is not None and left_ns > 0:
                    del wait  # not kept alive while waiting
                    self._changed.wait(min(left_ns / 1e9, RECHECK_S))
                    continue
                heapq.heappop(self._heap)
                if wait is not None:
                    return wait.expire
            self._thread = None
            return None


def _pending(reference: "weakref.ref[Expiring]") -> Expiring | None:
    wait = reference()
    return None if wait is None or wait.over() else wait


# Of the whole process.
deadlines = Deadlines()
