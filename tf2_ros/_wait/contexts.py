"""Owns which contexts the waits of a buffer depend on, and what their shutdown ends."""

import time
import weakref
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, Protocol

from rclpy.node import Node
from rclpy.utilities import get_default_context

from tf2_py import TimeoutException
from tf2_py._internal import wait_texts
from tf2_ros._forking import LOCK, register_for_fork
from tf2_ros._rclpy import context_was_shut_down, enter_handle
from tf2_ros._wait.deadlines import deadlines

__all__ = ["Shutdown", "WaitContexts", "await_checks", "fills", "node_has_ended", "unanswered"]

CHECK_NS = 100_000_000  # how often to check the contexts of what is awaited


class WaitContexts:
    """
    The contexts of what fills one buffer: that of its node, and those of its listeners, ended or not.

    :param contexts: those known already.
    """

    def __init__(self, *contexts: Any) -> None:
        self.known = contexts  # replaced, never changed: read without a lock

    def add(self, context: Any) -> None:
        """Something of this context fills the buffer, too; those shut down before do not count any more."""
        with LOCK:
            others = (one for one in self.known if one is not context and not context_was_shut_down(one))
            self.known = (*others, context)


_NOTHING_KNOWN = WaitContexts()


def fills(node: object, buffer: object) -> None:
    """Something of this node fills the buffer from now on; only a ``Buffer`` wants to know."""
    contexts = getattr(buffer, "_wait_contexts", None)
    if isinstance(node, Node) and isinstance(contexts, WaitContexts):
        contexts.add(node.context)


class Shutdown:
    """
    The shutdown that ends one wait, which begins when this is made.

    :param core: the buffer; this does not keep it alive.

    Nothing is inserted any more when every context of what fills the buffer was shut down. Where no such
    context is known, the program inserts by itself: then only a shutdown of the default context during the
    wait ends it, as Ctrl-C must.
    """

    __slots__ = ("_contexts", "_default")

    def __init__(self, core: object) -> None:
        self._contexts: WaitContexts = getattr(core, "_wait_contexts", _NOTHING_KNOWN)
        self._default = None
        if not self._contexts.known:
            default = get_default_context()
            if not context_was_shut_down(default):
                self._default = default

    def happened(self) -> bool:
        """Whether it was, also before the wait."""
        return all(context_was_shut_down(one) for one in self._contexts.known or (self._default,))


class Awaited(Protocol):
    """A wait that an asyncio loop awaits."""

    def is_in_vain(self) -> bool:
        """Whether a shutdown has ended it."""
        ...

    def end_with_context(self) -> None:
        """Wake the loop: it is in vain."""


class AwaitChecks:
    """
    Ends what asyncio loops await when it is in vain.

    An executor steps no task after the shutdown, but an asyncio loop goes on. While it awaits, the thread of
    the deadlines checks the contexts: a signal shuts a context down without calling anything.
    """

    def __init__(self) -> None:
        self._awaited: dict[object, weakref.ref[Awaited]] = {}  # a future may be awaited more than once
        self.after_fork()
        register_for_fork(self)

    def after_fork(self) -> None:
        """Begin anew: a forked child does not have the deadlines of its parent."""
        self._checking = False

    def begin(self, wait: Awaited) -> object:
        """
        End this when it is in vain, at once if it is so already; refers to it weakly.

        :return: what to give to :meth:`end`.
        """
        key = object()
        if wait.is_in_vain():
            wait.end_with_context()
            return key
        with LOCK:
            self._awaited[key] = weakref.ref(wait)
            beginning, self._checking = not self._checking, True
        if beginning:
            deadlines.add(time.monotonic_ns() + CHECK_NS, self)
        return key

    def end(self, key: object) -> None:
        """This await has ended."""
        with LOCK:
            self._awaited.pop(key, None)

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Never: only :meth:`expire` decides that there is nothing more to check."""
        return False

    def expire(self) -> None:
        """Check what is awaited, and again after CHECK_NS if something is awaited then."""
        with LOCK:
            awaited = [(key, reference()) for key, reference in self._awaited.items()]
        vain = [(key, wait) for key, wait in awaited if wait is None or wait.is_in_vain()]
        with LOCK:
            for key, _ in vain:
                self._awaited.pop(key, None)
            again = self._checking = bool(self._awaited)
        if again:
            deadlines.add(time.monotonic_ns() + CHECK_NS, self)
        for _, wait in vain:
            if wait is not None:
                wait.end_with_context()


# Of the whole process.
await_checks = AwaitChecks()


def node_has_ended(node: object) -> bool:
    """Whether a node was destroyed, or its context was shut down: nothing is received by it any more."""
    if not isinstance(node, Node):
        return False  # of a program's own kind
    with ExitStack() as uses:
        exists = enter_handle(node.handle, uses)
    return not exists or context_was_shut_down(node.context)


def unanswered(
    shutdown: Shutdown, begin_ns: int, timeout_ns: int | None, reason: Callable[[], object]
) -> TimeoutException:
    """
    What a future of a transform holds that ends without an answer.

    :param begin_ns: the steady time at which it began to wait.
    :param reason: what the lookup says, for a wait that timed out.
    """
    waited_ns = time.monotonic_ns() - begin_ns
    if timeout_ns is not None:
        waited_ns = min(waited_ns, timeout_ns)
    if shutdown.happened():
        return TimeoutException(wait_texts.shut_down(waited_ns))
    return TimeoutException(wait_texts.timed_out(reason(), waited_ns))
