"""Owns what an executor learns of a receiver: that messages arrived, and which user code it is to run."""

import threading
import traceback
import weakref
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import HistoryPolicy
from rclpy.subscription import Subscription
from rclpy.waitable import Waitable

from tf2_ros._forking import keep_for_ever
from tf2_ros._rclpy import has_ready_entities, new_wake_handle
from tf2_ros._receive.arrival_waitable import ArrivalWaitable

__all__ = ["Arrivals", "queue_depth"]

ENDLESS = 2**63 - 1

Completion = Callable[[], None]


class Arrivals(ArrivalWaitable, Waitable):
    """
    Tells the executor of a node of messages that a receiver took beside it.

    :param node: the listener's. It must keep this, by ``add_waitable()``, until :meth:`close`.
    :param group: the callback group in which the user code runs.
    :param depths: of the queues that the receiver takes from; it counts their messages by their index here.

    ``spin_once()`` returns once for each message, as if the executor had taken it. The loops of an executor
    (``rclpy.spin``, ``spin``, ``spin_until_future_complete``) do not need that: they are woken for user code,
    and otherwise ten times a second at most.

    User code runs in the executor as soon as the node has ever had one, otherwise in a thread of its own.
    """

    def __init__(self, node: Node, group: CallbackGroup, depths: Sequence[int]) -> None:
        Waitable.__init__(self, group)
        self._node = weakref.ref(node)
        self._guard = new_wake_handle(node.context)
        self.set_up(self._guard, depths)
        self._closed = False
        self._starting = threading.RLock()  # reentrant, because a finalizer may close this
        self._thread: threading.Thread | None = None

    def hand_over(self, completions: list[Completion]) -> bool:
        """
        Have the executor call these, in this order; from any thread.

        :return: False where that changes nothing, because the last ones to be called are the same.
        """
        if self.completed and self.completed[-1] == completions:
            return False
        self.completed.append(completions)
        if self._has_executor():
            self.wake()
        else:
            self._start_thread()
        return True

    def close(self) -> None:
        """Remove this from the node; what has been handed over is still called."""
        self._closed = True
        node = self._node()
        if node is not None and self in node.waitables:
            node.remove_waitable(self)
        if self.completed:
            self._start_thread()

    def after_fork(self) -> None:
        """End in a forked child."""
        keep_for_ever(self._guard)
        self._closed = True
        self.completed.clear()

    def others_ready(self, wait_set: Any) -> bool:
        """Whether something else of the node is ready to be executed."""
        return has_ready_entities(wait_set, self._node())

    async def execute(self, taken_data: list[Completion]) -> None:
        """Call what was completed. What one of them raises is raised when all were called."""
        _call(taken_data)

    def _has_executor(self) -> bool:
        if self._closed:
            return False
        # It may have been added to one that has not begun a round yet.
        node = self._node()
        return bool(self.spun or (node is not None and node.executor is not None))

    def _start_thread(self) -> None:
        with self._starting:
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="tf2_ros callbacks", daemon=True)
                self._thread.start()

    def _run(self) -> None:
        while True:
            with self._starting:
                if not self.completed or self._has_executor():
                    self._thread = None
                    break
            try:
                _call(self.completed.popleft())
            except BaseException:
                # No caller would catch it.
                get_logger("tf2_ros").error(f"In a callback of a future: {traceback.format_exc()}")
        if self.completed:
            self.wake()


def queue_depth(subscription: Subscription) -> int:
    """How many messages a subscription holds until they are taken."""
    qos = subscription.qos_profile
    return ENDLESS if qos.history == HistoryPolicy.KEEP_ALL else max(1, qos.depth)


def _call(completions: list[Completion]) -> None:
    error: BaseException | None = None
    for completion in completions:
        try:
            completion()
        except BaseException as raised:
            if error is None:
                error = raised
    if error is not None:
        raise error
