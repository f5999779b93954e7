"""Owns handing items from any thread to a function that runs in a node's executor."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from tf2_ros._forking import keep_for_ever, register_for_fork

__all__ = ["Handoff"]


class Handoff:
    """
    Hands items to ``take``, which the node's executor calls: one at a time, in the order of :meth:`put`.

    :param node: whoever spins it runs ``take``.
    :param take: called with each item. What it raises is raised by the spin; the items behind are not lost.
    :param group: a mutually exclusive callback group. None: one of its own.
    """

    def __init__(
        self, node: Node, take: Callable[[Any], None], group: MutuallyExclusiveCallbackGroup | None = None
    ) -> None:
        self._node = node
        self._take = take
        self._items: deque[Any] = deque()
        # Reentrant: a signal handler or a finalizer may close this while its thread is inside.
        self._closing = threading.RLock()
        self._closed = False
        own: CallbackGroup = MutuallyExclusiveCallbackGroup() if group is None else group
        self._guard = node.create_guard_condition(self._run, own)
        register_for_fork(self)

    def put(self, item: Any) -> None:
        """Hand an item over, from any thread; without effect once this is closed or the node destroyed."""
        self._items.append(item)
        self._wake()

    def clear(self) -> list[Any]:
        """Forget what has not been taken yet, and return it."""
        forgotten = []
        while (item := self._pop()) is not None:
            forgotten.append(item[0])
        return forgotten

    def close(self) -> None:
        """Forget what has not been taken yet, and end."""
        with self._closing:
            if self._closed:
                return
            self._closed = True
        self._node.destroy_guard_condition(self._guard)
        self._items.clear()

    def after_fork(self) -> None:
        """End, in a forked child: no executor takes anything there."""
        self._closing = threading.RLock()
        self._closed = True
        self._items.clear()
        keep_for_ever(self._guard.handle)

    def _wake(self) -> None:
        with self._closing:
            if self._closed:
                return
            try:
                self._guard.trigger()
            except InvalidHandle:
                self._closed = True  # the node was destroyed
        if self._closed:
            self._items.clear()

    def _pop(self) -> tuple[Any] | None:
        """The next item; None where there is none, or another thread has just taken the last one."""
        try:
            return (self._items.popleft(),)
        except IndexError:
            return None

    def _run(self) -> None:
        # No more than there are now: what is added meanwhile must not delay other callbacks of the executor.
        for _ in range(len(self._items)):
            item = self._pop()
            if item is None:
                return
            try:
                self._take(item[0])
            except BaseException:
                self._wake()
                raise
