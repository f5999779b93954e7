"""Owns daemon threads that run while they have something to call."""

import threading
import traceback
from collections.abc import Callable

from tf2_py._internal import log
from tf2_ros._forking import LOCK, register_for_fork

__all__ = ["Worker"]


class Worker:
    """
    A daemon thread that calls what ``_next()`` returns, one after the other; a subclass decides what that is.

    It starts with the first call and ends with the last. A forked child does not have it.

    :param name: of the thread.
    :param where: what a call is part of, for the log of what it raises.
    """

    def __init__(self, name: str, where: str) -> None:
        self._name = name
        self._where = where
        self.after_fork()
        register_for_fork(self)

    def after_fork(self) -> None:
        """Begin anew, without a thread."""
        self._thread: threading.Thread | None = None

    def _next(self) -> Callable[[], object] | None:
        """What to call, when that is due; None, with ``_thread`` set to None under LOCK: the thread ends."""
        raise NotImplementedError

    def _new_thread(self) -> threading.Thread | None:
        """With LOCK held: the thread that ``_start()`` is to start, or None where one runs already."""
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
        try:
            while (call := self._next()) is not None:
                try:
                    call()
                except BaseException:
                    # No caller would catch it, and the other calls must still be made.
                    log.logger("tf2_ros").error(f"{self._where}: {traceback.format_exc()}")
                del call  # not kept alive while waiting for the next
        finally:
            with LOCK:
                if self._thread is threading.current_thread():
                    self._thread = None  # it fails, for want of memory: the next call starts another
