"""Owns the delivery of items to user code: in a node's executor, or in a thread where it has none."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node

from tf2_ros._forking import LOCK
from tf2_ros._wait.deadlines import deadlines
from tf2_ros._wait.handoff import Handoff
from tf2_ros._wait.noticing_group import NoticingGroup
from tf2_ros._wait.worker import Worker

__all__ = ["Delivery"]


class Delivery(Handoff):
    """
    A :class:`Handoff` that works without an executor, too.

    :param node: its executor calls ``take``. Until it has one, a thread for callbacks does, and again some
        seconds after it had one.
    :param take: called with each item, one at a time, in the order of :meth:`put`.
    """

    def __init__(self, node: Node, take: Callable[[Any], None]) -> None:
        self.group = NoticingGroup(node)
        self._thread = _DeliveryThread(self)
        self._checking = False
        super().__init__(node, take, self.group)

    def put(self, item: Any) -> None:
        """As of :class:`Handoff`."""
        super().put(item)
        self.begin()

    def begin(self) -> None:
        """Have a thread call what is left, or look again when that may be its turn."""
        if self._closed or not self._items:
            return
        if not self.group.has_executor():
            self._thread.begin()
        elif not self._checking:
            # No executor tells that it has given a node away.
            self._checking = True
            deadlines.add(self.group.free_at_ns(), self)

    def next_item(self) -> Callable[[], None] | None:
        """What to call next; None where nothing is left."""
        item = self._pop()
        return None if item is None else partial(self._take, item[0])

    def thread_ended(self) -> None:
        """What is left is for the executor that the node has got."""
        if self._items:
            self._wake()
            self.begin()

    def _run(self) -> None:
        # The thread may be inside a call that began before the first spin.
        if not self._thread.runs:
            super()._run()

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Whether nothing is to be called any more."""
        return self._closed

    def expire(self) -> None:
        """Look again whether the executor still has the node."""
        self._checking = False
        self.begin()


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
        with LOCK:
            starting = self._new_thread()
        self._start(starting)

    def _next(self) -> Callable[[], None] | None:
        has_executor = self._delivery.group.has_executor()
        with LOCK:
            call = None if has_executor else self._delivery.next_item()
            if call is None:
                self._thread = None
        if call is None:
            self._delivery.thread_ended()
        return call
