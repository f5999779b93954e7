"""Owns which context the waits of a buffer depend on, and what its shutdown ends."""

import time
import weakref
from collections.abc import Callable
from typing import Any, Protocol

from rclpy.utilities import get_default_context

from tf2_py import BufferCore, TimeoutException
from tf2_py._internal import wait_texts
from tf2_ros._forking import LOCK, register_for_fork
from tf2_ros._rclpy import context_was_shut_down, context_was_started
from tf2_ros._wait.deadlines import deadlines

__all__ = ["WaitContext", "unanswered", "wait_context"]

CHECK_NS = 100_000_000  # how often to check the context of what is awaited


class Awaited(Protocol):
    """A wait that an asyncio loop awaits."""

    def end_with_context(self) -> None:
        """The context was shut down."""


class WaitContext:
    """
    The context whose shutdown ends the waits of one buffer.

    :param context: of the buffer's node. None: the default one.

    An executor steps no task after the shutdown, but an asyncio loop goes on. While it awaits, the thread of
    the deadlines checks the context: a signal shuts a context down without calling anything.
    """

    def __init__(self, context: Any) -> None:
        self._own = context
        self._default = get_default_context() if context is None else None
        self._awaited: dict[object, weakref.ref[Awaited]] = {}  # a future may be awaited more than once
        self.after_fork()
        register_for_fork(self)

    def after_fork(self) -> None:
        """Begin anew: a forked child does not have the deadlines of its parent."""
        self._checking = False

    def current(self) -> Any:
        """
        The context that counts now; it may never be started.

        rclpy replaces the default context when it is shut down. The one before counts until the next one is
        started.
        """
        if self._own is not None:
            return self._own
        default = get_default_context()
        if default is not self._default and context_was_started(default):
            self._default = default
        return self._default

    def ended(self) -> bool:
        """Whether it was shut down."""
        return context_was_shut_down(self.current())

    def begin_await(self, wait: Awaited) -> object:
        """
        End this wait with the context, at once if that was shut down before; refers to it weakly.

        :return: what to give to :meth:`end_await`.
        """
        key = object()
        if self.ended():
            wait.end_with_context()
            return key
        with LOCK:
            self._awaited[key] = weakref.ref(wait)
            beginning, self._checking = not self._checking, True
        if beginning:
            deadlines.add(time.monotonic_ns() + CHECK_NS, self)
        return key

    def end_await(self, key: object) -> None:
        """This await has ended."""
        with LOCK:
            self._awaited.pop(key, None)

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Never: only :meth:`expire` decides that there is nothing more to check."""
        return False

    def expire(self) -> None:
        """Check the context, and again after CHECK_NS if something is awaited then."""
        ended = self.ended()
        with LOCK:
            awaited = list(self._awaited.values())
            if ended:
                self._awaited.clear()
            self._checking = bool(awaited) and not ended
        if ended:
            for reference in awaited:
                if (wait := reference()) is not None:
                    wait.end_with_context()
        elif awaited:
            deadlines.add(time.monotonic_ns() + CHECK_NS, self)


def wait_context(core: BufferCore | None) -> WaitContext | None:
    """That of a buffer; a core without waits of its own has none."""
    return getattr(core, "_wait_context", None)


def unanswered(
    core: BufferCore, begin_ns: int, timeout_ns: int | None, reason: Callable[[], object]
) -> TimeoutException:
    """
    What a future of a transform holds that ends without an answer.

    :param begin_ns: the steady time at which it began to wait.
    :param reason: what the lookup says, for a wait that timed out.
    """
    waited_ns = time.monotonic_ns() - begin_ns
    if timeout_ns is not None:
        waited_ns = min(waited_ns, timeout_ns)
    context = wait_context(core)
    if context is not None and context.ended():
        return TimeoutException(wait_texts.shut_down(waited_ns))
    return TimeoutException(wait_texts.timed_out(reason(), waited_ns))
