# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The topics of a listener: their subscriptions, and what was received and lost on them."""

import time
import weakref
from collections.abc import Sequence
from typing import Any

from rclpy.qos import QoSProfile

from tf2_py._internal import log
from tf2_py.printable import counted
from tf2_ros._nodes.topic_publishers import published_instead
from tf2_ros._process.background import check_regularly
from tf2_ros._qos import is_latched
from tf2_ros._rclpy import context_was_shut_down, event_handlers, handle_exists, report_event, watch_losses
from tf2_ros._receive.subscriptions import TopicArrivals

LOSS_WARNING_S = 60.0  # between two warnings that messages of a topic were lost, at least


class Topic:
    """
    A topic of a listener.

    :param attribute: of the listener, for the subscription.
    :param method: of the listener, that is called with each message if an executor takes it.
    :param name: to subscribe to; from then on, that of the subscription.
    :param qos: None: the usual one of dynamic or static transforms.
    """

    def __init__(
        self, attribute: str, method: str, name: str, qos: QoSProfile | int | None, *, is_static: bool
    ) -> None:
        self.attribute, self.method, self.name, self.qos = attribute, method, name, qos
        self.is_static = is_static
        self.is_own = True  # whether the method is TransformListener's, so that `arrivals` counts all
        self.subscription: Any = None  # of rclpy's class or a subclass
        self.context: Any = None  # of the subscription
        self.published_instead = ""  # as far as the graph shows it; only while nothing was received
        self._node: weakref.ref[Any] | None = None
        self.arrivals = TopicArrivals()
        self._loss_handler: Any = None
        self._lost = 0  # on the way, as far as the middleware has reported it
        self._warned_of = 0, 0  # lost messages, as `lost` returns them
        self._warned_at = -LOSS_WARNING_S

    def begin(self, node: Any, subscription: Any) -> None:
        """Note the subscription, and have its lost messages counted."""
        self.subscription, self.name = subscription, subscription.topic_name
        self.context = getattr(node, "context", None)
        self._node = weakref.ref(node)
        topic = weakref.ref(self)

        def note(event: Any) -> None:
            if (this := topic()) is not None:
                this._lost = event.total_count

        # A latched topic lacks only what its publisher has replaced by a later message. The middleware
        # reports that as lost, for example while it sends what is kept to a new subscription.
        if not is_latched(subscription.qos_profile):
            self._loss_handler = watch_losses(node, subscription, note)
        check_regularly(self)

    def destroy(self) -> None:
        """Destroy the subscription, after what belongs to it."""
        if self._loss_handler is not None:
            self._loss_handler.destroy()
        type(self.subscription).destroy(self.subscription)

    def is_open(self) -> bool:
        """Whether anything can be received on it."""
        if self.subscription is None or context_was_shut_down(self.context):
            return False
        return handle_exists(self.subscription.handle)

    def has(self, entity: object) -> bool:
        """Whether an entity of executors is its subscription, or an event of that."""
        return entity is self.subscription or entity in event_handlers(self.subscription)

    def describe(self) -> str:
        """Describe its name, how many messages there were, and when the last one was."""
        count, last_ns = self.arrivals.taken()
        facts = counted(count, "message") if count or self.is_own else "messages not counted"
        if count:
            facts += f", last {(time.monotonic_ns() - last_ns) / 1e9:.2f} s ago"
        if lost := sum(self.lost()):
            facts += f", {lost} lost"
        return f"{self.name}: {facts}" if self.is_open() else f"{self.name}: {facts}, ended"

    def lost(self) -> tuple[int, int]:
        """
        Return how many messages were lost on the way here, and how many in the queue of the subscription.

        The middleware reports the former, if it can; of a latched topic, they are not counted. The latter are
        those that newer ones have displaced; they are not known where an executor takes the messages.
        """
        if self._loss_handler is not None:
            report_event(self._loss_handler)
        return self._lost, self.arrivals.overwritten()

    def _tf2_check(self) -> None:
        """Warn if messages were lost since the last warning; if there were none, look for the reason."""
        node = None if self._node is None else self._node()
        instead = ""
        if node is not None and not self.arrivals.taken()[0] and self.is_open():
            instead = " and ".join([*published_instead(node, self.name)][:2])
        self.published_instead = instead
        lost, now = self.lost(), time.monotonic()
        if lost == self._warned_of or now - self._warned_at < LOSS_WARNING_S:
            return
        on_the_way, overwritten = (one - before for one, before in zip(lost, self._warned_of, strict=True))
        self._warned_of, self._warned_at = lost, now
        if overwritten:
            option = "static_qos" if self.is_static else "qos"
            depth = self.subscription.qos_profile.depth
            self._warn(
                overwritten,
                f"newer ones displaced them in the queue, whose depth is {depth}. Give the listener a "
                f"deeper queue, for example {option}={max(10 * depth, 100)}",
            )
        if on_the_way:
            self._warn(
                on_the_way,
                "they did not reach the listener. Make the listener and publishers reliable, and give the "
                "publishers deeper queues",
            )

    def _warn(self, count: int, why: str) -> None:
        log.logger("tf2_ros").warning(f"Lost {counted(count, 'message')} on {self.name}: {why}")


def describe_topics(topics: Sequence[Topic]) -> str:
    """Describe the topics with a subscription of rclpy's."""
    return "; ".join([topic.describe() for topic in topics if topic.subscription is not None])
