"""Owns daemon threads that are there while they have something to call."""

import threading
import traceback
from collections.abc import Callable

from rclpy.logging import get_logger

from tf2_ros._forking import tell_of_fork

__all__ = ["Worker"]


class Worker:
    """
    A daemon thread that calls what `_next()` gives, one after the other: a base for who decides what that is.

    It starts with the first call and ends with the last. In a forked child nothing is left of it.

    :param name: of the thread.
    :param where: what a call is part of, for the log of what it raises.
    """

    def __init__(self, name: str, where: str) -> None:
        self._name = name
        self._where = where
        self.after_fork()
        tell_of_fork(self)

    def after_fork(self) -> None:
        """Begin anew."""
        self._thread: threading.Thread | None = None

    def _next(self) -> Callable[[], object] | None:
        """What to call, when it is time; None, with `_thread` set to None under LOCK: the thread ends."""
        raise NotImplementedError

    def _wanted(self) -> threading.Thread | None:
        """With LOCK held: the thread that `_start()` is to start, or None where there is one."""
        if self._thread is not None:
            return None
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        return self._thread

    def _start(self, thread: threading.Thread | None) -> None:
        """Not under LOCK: a thread that starts may run finalizers, which may wait for it."""
        if thread is None:
            return
        try:
            thread.start()
        except BaseException:
            self._thread = None  # the next one tries again
            raise

    def _run(self) -> None:
        while (call := self._next()) is not None:
            try:
                call()
            except BaseException:
                # Nobody is above to catch it, and the others must not suffer from it.
                get_logger("tf2_ros").error(f"{self._where}: {traceback.format_exc()}")
            del call  # not held while waiting for the next
