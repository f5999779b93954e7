"""Owns the thread that runs user callbacks where no executor does."""

from collections import deque
from collections.abc import Callable

from tf2_ros._forking import LOCK
from tf2_ros._wait.worker import Worker

__all__ = ["CallbackThread", "callback_thread"]


class CallbackThread(Worker):
    """Calls what it is given, in the order of the calls of :meth:`put`."""

    def __init__(self) -> None:
        super().__init__("tf2_ros callbacks", "In a callback of a future")

    def after_fork(self) -> None:
        """Begin anew: the calls of before the fork are the parent's."""
        super().after_fork()
        self._calls: deque[Callable[[], None]] = deque()

    def put(self, call: Callable[[], None]) -> None:
        """Call this; from any thread."""
        with LOCK:
            self._calls.append(call)
            starting = self._new_thread()
        self._start(starting)

    def _next(self) -> Callable[[], None] | None:
        with LOCK:
            if self._calls:
                return self._calls.popleft()
            self._thread = None
            return None


# Of the whole process.
callback_thread = CallbackThread()
