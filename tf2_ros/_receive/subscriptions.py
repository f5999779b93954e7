"""Owns what takes from a listener's subscriptions: a receiver, or the executors of their node."""

from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import EventHandler
from rclpy.node import Node
from rclpy.subscription import Subscription

from tf2_ros._rclpy import (
    hide_from_executors,
    set_subscription_callback,
    show_to_executors,
    subscription_callback,
)

__all__ = ["ListenerGroup", "ReceivedSubscription", "wake_executor"]


def wake_executor(node: Any) -> None:
    """Have the executor of a node, if it has one, gather again what it waits for."""
    executor = node.executor if isinstance(node, Node) else None
    if executor is not None:
        executor.wake()


class ReceivedSubscription(Subscription):
    """
    A subscription that a receiver takes from, and no executor.

    ``tf2_receiver_thread`` is informed of changes; None once the subscription was given back to executors.
    """

    tf2_receiver_thread: Any
    # Waiting for one of its events, an executor would be woken by each message: the node must not have them.
    tf2_event_handlers: list[EventHandler]
    event_handlers: Any

    @classmethod
    def adopt(cls, subscription: Any, node: Node, receiver_thread: Any) -> None:
        """Make a subscription one of these."""
        subscription.tf2_receiver_thread = receiver_thread
        subscription.tf2_event_handlers = list(subscription.event_handlers)
        for handler in subscription.tf2_event_handlers:
            node.remove_waitable(handler)
        subscription.event_handlers = []
        hide_from_executors(subscription)
        subscription.__class__ = cls

    def give_back(self, node: Node | None) -> None:
        """Let executors take from it."""
        self.tf2_receiver_thread = None
        show_to_executors(self)
        if node is not None:
            self.event_handlers, self.tf2_event_handlers = self.tf2_event_handlers, []
            for handler in self.event_handlers:
                node.add_waitable(handler)

    @property
    def callback(self) -> Any:
        """What is called with each message."""
        return subscription_callback(self)

    @callback.setter
    def callback(self, value: Any) -> None:
        set_subscription_callback(self, value)
        if self.tf2_receiver_thread is not None:
            self.tf2_receiver_thread.decide_again()

    def destroy(self) -> None:
        """End it: the receiver's thread uses it all the time, and must stop that first."""
        if self.tf2_receiver_thread is not None:
            if self.tf2_receiver_thread.forked:
                return
            self.tf2_receiver_thread.drop_subscription(self)
        for handler in self.tf2_event_handlers:
            handler.destroy()
        super().destroy()


class ListenerGroup(ReentrantCallbackGroup):
    """
    The callback group of a listener: no executor waits for subscriptions that a receiver takes from.

    Reentrant, so that transforms arrive while another callback of the node waits for them. What a program
    adds to it is executed as in any other group.
    """

    def __init__(self) -> None:
        super().__init__()
        self._undecided = True

    def can_execute(self, entity: Any) -> bool:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Whether an executor may run it."""
        return not (self._undecided and isinstance(entity, (Subscription, EventHandler)))

    def decide(self) -> None:
        """Until this is called, no executor takes from any subscription."""
        self._undecided = False
