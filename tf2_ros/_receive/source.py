"""Owns one subscription that a receiver takes from, and the event that a publisher's QoS does not fit it."""

import weakref
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from rclpy.logging import get_logger
from rclpy.qos import qos_policy_name_from_kind
from rclpy.subscription import Subscription

from tf2_ros._rclpy import enter_handle, handle_pointer, incompatible_qos_event

__all__ = ["Source"]


class Source:
    """
    A subscription without its node.

    :param number: under which its messages are counted.
    :param collected: called when the subscription was garbage-collected, with a weak reference.
    """

    def __init__(
        self, number: int, subscription: Subscription, is_static: bool, collected: Callable[[Any], None]
    ) -> None:
        self.number = number
        self.is_static = is_static
        self.subscription = weakref.ref(subscription, collected)
        self.handle = subscription.handle
        self._topic = subscription.topic_name
        self._logger = get_logger(subscription.logger_name)
        self._event = incompatible_qos_event(self.handle)
        if self._event is None:
            self._logger.debug("this middleware does not report publishers with incompatible QoS")

    def use(self, uses: ExitStack) -> bool:
        """Keep it from being destroyed; whether it still existed."""
        return enter_handle(self.handle, uses) and (self._event is None or enter_handle(self._event, uses))

    def as_tuple(self) -> tuple[int, int, int, str, bool]:
        """It as ``Receiver.run`` takes it."""
        event = 0 if self._event is None else handle_pointer(self._event)
        return self.number, handle_pointer(self.handle), event, self._topic, self.is_static

    def report_event(self, happened: list[int]) -> None:
        """Log its event if that is among those that happened."""
        if self._event is None or handle_pointer(self._event) not in happened:
            return
        event = self._event.take_event()
        if event is not None:
            self._logger.warning(
                # As rclpy says it of subscriptions that an executor takes from.
                f"New publisher discovered on topic '{self._topic}', offering incompatible QoS. "
                f"No messages will be received from it. Last incompatible policy: "
                f"{qos_policy_name_from_kind(event.last_policy_kind)}"
            )

    def destroy(self) -> None:
        """Stop using the subscription; its owner destroys it."""
        if self._event is not None:
            self._event.destroy_when_not_in_use()
