"""The topics of a listener: what to subscribe to, what takes the messages, and how many there were."""

import itertools
import time
from contextlib import ExitStack
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from tf2_py._internal import counted
from tf2_ros._rclpy import enter_handle
from tf2_ros._receive.subscriptions import TopicArrivals


class Topic:
    """
    A topic of a listener.

    :param attribute: of the listener, for the subscription.
    :param method: of the listener, that is called with each message if an executor takes it.
    :param name: to subscribe to; from then on, that of the subscription.
    :param qos: what the program has chosen, or None.
    """

    def __init__(
        self, attribute: str, method: str, name: str, qos: QoSProfile | int | None, *, is_static: bool
    ) -> None:
        self.attribute, self.method, self.name, self.qos = attribute, method, name, qos
        self.is_static = is_static
        self.subscription: Subscription | None = None  # of rclpy's class or a subclass
        self.is_counted = True  # whether :meth:`received` counts all: the listener's own method has them
        self.receiver: Any = None  # the Receiver that takes the messages; None: executors do
        self.arrivals = TopicArrivals()  # what the receiver takes
        # Several threads of an executor may count.
        self._counter = itertools.count(1)
        self._called = 0
        self._called_at_ns = 0

    def count_call(self) -> None:
        """Count a message with which an executor has called the listener."""
        self._called = next(self._counter)
        self._called_at_ns = time.monotonic_ns()

    def received(self) -> tuple[int, int]:
        """Return how many messages there were, and the steady time of the last one in nanoseconds."""
        if self.receiver is not None:
            self.receiver.inbox.catch_up()
        taken, taken_at_ns = self.arrivals.taken()
        return taken + self._called, max(taken_at_ns, self._called_at_ns)

    def is_open(self) -> bool:
        """Whether its subscription exists."""
        with ExitStack() as uses:
            return self.subscription is not None and enter_handle(self.subscription.handle, uses)

    def describe(self) -> str:
        """Describe its name, how many messages there were, when the last one was, and what takes them."""
        count, last_ns = self.received()
        if count == 0 and not self.is_counted:
            facts = "messages not counted"
        else:
            facts = counted(count, "message")
            if count:
                facts += f", last {(time.monotonic_ns() - last_ns) / 1e9:.2f} s ago"
        if not self.is_open() or not (self.receiver is None or self.receiver.alive):
            facts += ", ended"
        elif self.receiver is None:
            facts += ", taken by an executor"
        return f"{self.name}: {facts}"
