"""Owns what an executor sees of a receiver: that messages arrived, and the users' code that they set off."""

import threading
import traceback
import weakref
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.guard_condition import GuardCondition
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import HistoryPolicy
from rclpy.subscription import Subscription
from rclpy.waitable import Waitable

from tf2_ros._forking import keep_for_ever

ArrivalWaitable: Any
try:
    # After rclpy, which loads the libraries that it needs.
    from tf2_ros._receive.arrival_waitable import ArrivalWaitable
except ModuleNotFoundError:
    ArrivalWaitable = type("ArrivalWaitable", (), {})  # there was nothing to build it with, and no receiver

__all__ = ["Arrivals"]

ENDLESS = 2**63 - 1

Completion = Callable[[], None]


class Arrivals(ArrivalWaitable, Waitable):
    """
    Tells the executor of a node of messages that a receiver took beside it.

    :param node: the listener's. It must hold this, by ``add_waitable()``, until :meth:`close`.
    :param group: in which callback group the users' code runs.
    :param subscriptions: those that the receiver takes from; it counts their messages by their places here.

    ``spin_once()`` returns once for each message, as if the executor had taken it. In the loops of an
    executor (``rclpy.spin``, ``spin``, ``spin_until_future_complete``) that would be for nothing, so these
    are woken for users' code, and besides ten times a second at most.

    That code runs in the executor as soon as the node has ever had one, otherwise in a thread of its own.
    """

    def __init__(self, node: Node, group: CallbackGroup, subscriptions: Sequence[Subscription]) -> None:
        Waitable.__init__(self, group)
        self._node = weakref.ref(node)
        self._guard = GuardCondition(None, None, node.context).handle
        self.set_up(self._guard, [_queue_depth(subscription) for subscription in subscriptions])
        self._closed = False
        self._starting = threading.RLock()  # reentrant, for a finalizer may close this
        self._thread: threading.Thread | None = None

    def hand_over(self, completions: list[Completion]) -> bool:
        """
        Have the executor call these, in this order; from any thread.

        :return: False where that changes nothing, for the same ones are the last that it is going to call.
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
        """Leave the node; what has been handed over is still called."""
        self._closed = True
        node = self._node()
        if node is not None and self in node.waitables:
            node.remove_waitable(self)
        if self.completed:
            self._start_thread()

    def after_fork(self) -> None:
        """Be dead in a forked child."""
        keep_for_ever(self._guard)
        self._closed = True
        self.completed.clear()

    def others_ready(self, wait_set: Any) -> bool:
        """Whether something else of the node is ready to be executed."""
        if any(map(wait_set.get_ready_entities, ("subscription", "service", "client"))):
            return True
        ready, node = wait_set.get_ready_entities("timer"), self._node()
        return (
            bool(ready)
            and node is not None
            and any(one.handle.pointer in ready and one.handle.is_timer_ready() for one in node.timers)
        )

    async def execute(self, taken_data: list[Completion]) -> None:
        """Call what was completed; what one of them raises comes after all of them were called."""
        _call(taken_data)

    def _has_executor(self) -> bool:
        if self._closed:
            return False
        # It may have been added to one that has not come round yet.
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
                # Nobody is above to catch it.
                get_logger("tf2_ros").error(f"In a callback of a future: {traceback.format_exc()}")
        if self.completed:
            self.wake()


def _queue_depth(subscription: Subscription) -> int:
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
