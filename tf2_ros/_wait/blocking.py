"""Owns the wait of a thread for a transform, without the GIL, and what ends it early."""

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from tf2_py import BufferCore, InvalidArgumentException, TransformException
from tf2_py._internal import wait_texts
from tf2_ros._wait.long_waits import report_if_long
from tf2_ros._wait.lookup import Lookup
from tf2_ros_cython._presence import HAS_ROS

if TYPE_CHECKING or HAS_ROS:
    from tf2_ros._wait.contexts import Shutdown
else:
    from tf2_ros._without_ros import Shutdown

__all__ = ["BlockingWait"]

POLL_PERIOD_S = 0.02  # what replaced methods answer may depend on anything


class BlockingWait:
    """
    The wait of the calling thread, which begins when this is made.

    :param core: the buffer, whose :class:`Shutdown` ends the wait.
    :param timeout_ns: nanoseconds of steady time, at most FOR_EVER_NS. 0 or less: there is no wait.
    """

    def __init__(self, core: BufferCore, timeout_ns: int) -> None:
        self._core = core
        self._shutdown = Shutdown(core)
        self._timeout_ns = timeout_ns
        self._begin_ns = time.monotonic_ns()
        self._waits = timeout_ns > 0

    def for_answer(self, lookup: Lookup) -> Any:
        """
        Wait, without the GIL, until there is an answer, and return it.

        When the wait has ended, what the lookup raises is raised, with the text of :meth:`told`. An invalid
        name is raised at once.
        """
        if not self._waits:
            return lookup.now(self._core)
        while True:
            try:
                wait = lookup.wait(self._core)
            except TransformException:
                self._waits = False
                raise
            answer = wait.answer
            if answer is not None:
                return answer
            report = report_if_long([wait])
            if wait.wait_for(self._timeout_ns, self._alive):
                return wait.answer
            del report
            reason = wait.reason()
            if reason is not None:
                raise self.error(reason)
            # It has arrived between the two: the next lookup finds it.

    def poll(self, can: Callable[[], Any]) -> None:
        """Poll until the answer is yes, or the wait has ended."""
        deadline_ns = self._begin_ns + self._timeout_ns
        while time.monotonic_ns() < deadline_ns and not can():
            if not self._alive():
                return
            threading.Event().wait(POLL_PERIOD_S)

    def told(self, reason: str) -> str:
        """Why there is no answer: what the lookup says, and how long was waited, or what ended the wait."""
        if not self._waits:
            return reason
        waited_ns = min(time.monotonic_ns() - self._begin_ns, self._timeout_ns)
        return wait_texts.waited(reason, waited_ns) if self._alive() else wait_texts.shut_down(waited_ns)

    def error(self, error: TransformException) -> TransformException:
        """
        The same of an error of the lookup; its class remains, because programs catch that.

        That of an invalid argument stays as it is: no wait would have helped.
        """
        if isinstance(error, InvalidArgumentException):
            return error
        text = str(error)
        told = self.told(text)
        # A program's own class may not be made of a text.
        return error if told == text or type(error).__module__ != "tf2_py" else type(error)(told)

    def _alive(self) -> bool:
        return not self._shutdown.happened()
