"""Owns turns at a lock that one thread takes for a long work in slices, and others for short steps."""

import threading
from collections import deque

__all__ = ["Turns"]

GIVE_WAY_S = 0.01  # at most: a short step may itself wait for something


class Turns:
    """
    A context for short steps, entered before the lock is taken, and what the long work does between slices.

    A thread that takes a lock of Python again at once mostly gets it before those that have been waiting.
    """

    def __init__(self) -> None:
        self.after_fork()

    def after_fork(self) -> None:
        """Begin anew: the steps of the parent's other threads never end in a forked child."""
        self._steps: deque[None] = deque()
        self._done = threading.Event()
        self._done.set()

    def __enter__(self) -> None:
        self._steps.append(None)

    def __exit__(self, *_: object) -> None:
        self._steps.pop()
        if not self._done.is_set():
            self._done.set()

    def give_way(self) -> None:
        """Without the lock: if a short step waits for it, let one go first."""
        if self._steps:
            self._done.clear()
            if self._steps:  # otherwise it ended before
                self._done.wait(GIVE_WAY_S)
