"""Owns the delivery of items to user code: in a node's executor, or in a thread while it never had one."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node

from tf2_ros._forking import LOCK
from tf2_ros._wait.handoff import Handoff
from tf2_ros._wait.worker import Worker

__all__ = ["Delivery"]


class Delivery(Handoff):
    """
    A :class:`Handoff` that works without an executor, too.

    :param node: its executor calls ``take``. As long as it never had one, a thread for callbacks does.
    :param take: called with each item, one at a time, in the order of :meth:`put`.
    """

    def __init__(self, node: Node, take: Callable[[Any], None]) -> None:
        self._group = _NoticingGroup()
        self._thread = _DeliveryThread(self)
        super().__init__(node, take, self._group)

    def put(self, item: Any) -> None:
        """As of :class:`Handoff`."""
        super().put(item)
        self._thread.begin()

    def has_executor(self) -> bool:
        """Whether the node has, or ever had, an executor that waits for it."""
        # It may have been added to one that has not begun a round yet.
        return self._group.spun or self._node.executor is not None

    def next_for_thread(self) -> Callable[[], None] | None:
        """What a thread is to call; None where nothing is left, or an executor calls it."""
        if self.has_executor():
            return None
        item = self._pop()
        return None if item is None else partial(self._take, item[0])

    def thread_ended(self) -> None:
        """What is left is for the executor that the node has got."""
        if self._items:
            self._wake()

    def _run(self) -> None:
        # The thread may be inside a call that began before the first spin.
        if not self._thread.runs:
            super()._run()


class _NoticingGroup(MutuallyExclusiveCallbackGroup):
    """A callback group that knows whether an executor has ever asked it."""

    spun = False

    def can_execute(self, entity: Any) -> bool:
        """Whether an executor may run it."""
        self.spun = True
        can: bool = super().can_execute(entity)
        return can


class _DeliveryThread(Worker):
    """Calls what is delivered as long as the node has no executor."""

    def __init__(self, delivery: Delivery) -> None:
        self._delivery = delivery
        super().__init__("tf2_ros callbacks", "In a callback of a message filter")

    @property
    def runs(self) -> bool:
        """Whether it is, or is about to be, inside a call."""
        return self._thread is not None

    def begin(self) -> None:
        """Something may be left to call."""
        if self._delivery.has_executor():
            return
        with LOCK:
            starting = self._new_thread()
        self._start(starting)

    def _next(self) -> Callable[[], None] | None:
        with LOCK:
            call = self._delivery.next_for_thread()
            if call is None:
                self._thread = None
        if call is None:
            self._delivery.thread_ended()
        return call
