"""Owns the thread that takes in what comes on a listener's subscriptions, beside all executors."""

import atexit
import logging
import os
import threading
import time
import traceback
import weakref
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.event_handler import (
    QoSSubscriptionEventType,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logger
from rclpy.qos import qos_policy_name_from_kind
from rclpy.subscription import Subscription

from tf2_py import BufferCore

Receiver: Any
try:
    # After rclpy, which loads the libraries that it needs.
    from tf2_py._receiver import Receiver
except ModuleNotFoundError:
    Receiver = None  # there was nothing to build it with

__all__ = ["ReceivedGroup", "Receiving", "can_receive", "no_events"]

CALLBACK_WAIT_S = 1.0  # for a future's callback that runs in the thread when it is to end
RETRY_S = 0.5

_running: "weakref.WeakSet[Receiving]" = weakref.WeakSet()


def can_receive() -> bool:
    """Whether the receiver could be built here."""
    return Receiver is not None


class ReceivedGroup(ReentrantCallbackGroup):
    """The callback group of received subscriptions: no executor waits for them, or takes from them."""

    def can_execute(self, entity: Any) -> bool:
        """Whether an executor may run it."""
        return not isinstance(entity, Subscription)


def no_events() -> SubscriptionEventCallbacks:
    """The events of a received subscription: by any of them, each message would wake the executor."""
    return SubscriptionEventCallbacks(use_default_callbacks=False)


class Receiving:
    """
    Takes what comes on subscriptions into a buffer, in a thread of its own.

    :param subscriptions: at most two, each with whether its transforms are static.

    The thread ends with :meth:`stop`, with the last of the subscriptions, with the context and with the
    interpreter; a forked child has none. It keeps alive neither the buffer nor the node.
    """

    def __init__(
        self,
        buffer: BufferCore,
        authority: str,
        context: Context,
        subscriptions: Sequence[tuple[Subscription, bool]],
    ) -> None:
        self._receiver = Receiver(buffer, authority)
        self._context = context.handle
        self._guard = GuardCondition(None, None, context)
        self._sources = [_Source(*subscription) for subscription in subscriptions]
        self._stopping = False
        self._forked = False
        # A daemon, so that the interpreter does not wait for it before it runs the exit handlers.
        self._thread = threading.Thread(target=self._run, name="tf2_ros receiver", daemon=True)
        for subscription, _ in subscriptions:
            self._leave_before_it_goes(subscription)
        context.on_shutdown(self._context_ended)  # held weakly there
        _running.add(self)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether it goes on."""
        return self._thread.is_alive()

    def stop(self, *, wait: bool = True) -> None:
        """
        End the thread.

        :param wait: until it has ended, unless this is that thread.
        """
        self._stopping = True
        self._wake(wait)

    def _wake(self, wait: bool) -> None:
        if self._forked:
            return  # what it would be woken by may have been in use when the process forked
        self._guard.trigger()
        if wait and self._thread is not threading.current_thread():
            # Not for ever: the callback that it may be in may itself wait for whoever waits here.
            self._thread.join(CALLBACK_WAIT_S)

    def _context_ended(self) -> None:
        # The context is locked meanwhile.
        self.stop(wait=False)

    def _leave_before_it_goes(self, subscription: Subscription) -> None:
        # A subscription goes when nobody uses it any more, and the thread always does. This is how its node
        # destroys it, by itself or together with the node.
        handle, destroy = subscription.handle, subscription.destroy

        def leave_and_destroy() -> None:
            subscription.__dict__.pop("destroy", None)
            self._leave(handle)
            destroy()

        subscription.destroy = leave_and_destroy

    def _leave(self, handle: Any) -> None:
        for source in self._sources:
            if source.handle is handle:
                source.destroy()
        self._sources = [source for source in self._sources if source.handle is not handle]
        self._wake(wait=not self._sources)

    def _run(self) -> None:
        while not self._stopping:
            try:
                if not self._serve():
                    return
            except Exception:
                get_logger("tf2_ros").error(f"No transforms for {RETRY_S} s: {traceback.format_exc()}")
                time.sleep(RETRY_S)

    def _serve(self) -> bool:
        """Work until something changes; whether there is more to do."""
        with ExitStack() as uses:
            sources = [source for source in self._sources if source.use(uses)]
            if not sources or not _use(self._context, uses):
                return False
            uses.enter_context(self._guard.handle)
            happened = self._receiver.run(
                self._context.pointer, self._guard.handle.pointer, [source.as_tuple() for source in sources]
            )
            if happened is None:
                return False
            for source in sources:
                source.tell_of(happened)
            return True


class _Source:
    """A subscription without its node, and what is to be told of it: publishers that it cannot hear."""

    def __init__(self, subscription: Subscription, is_static: bool) -> None:
        self.handle = subscription.handle
        self._topic = subscription.topic_name
        self._is_static = is_static
        self._logger = get_logger(subscription.logger_name)
        self._event: Any = None
        try:
            with self.handle:
                self._event = rclpy_implementation.EventHandle(
                    self.handle, QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS
                )
        except UnsupportedEventTypeError:
            self._logger.debug("this middleware does not tell of publishers with incompatible QoS")

    def use(self, uses: ExitStack) -> bool:
        """Keep it from being destroyed; whether it was still there."""
        return _use(self.handle, uses) and (self._event is None or _use(self._event, uses))

    def as_tuple(self) -> tuple[int, int, str, bool]:
        """It as the receiver takes it."""
        event = 0 if self._event is None else self._event.pointer
        return self.handle.pointer, event, self._topic, self._is_static

    def tell_of(self, happened: list[int]) -> None:
        """Say so if its event is among those that happened."""
        if self._event is None or self._event.pointer not in happened:
            return
        event = self._event.take_event()
        if event is not None:
            self._logger.warning(
                f"A publisher on topic '{self._topic}' is offering incompatible QoS: nothing will come from "
                f"it. The policy that does not fit: {qos_policy_name_from_kind(event.last_policy_kind)}"
            )

    def destroy(self) -> None:
        """Let the subscription go; who owns it destroys it."""
        if self._event is not None:
            self._event.destroy_when_not_in_use()


def _use(handle: Any, uses: ExitStack) -> bool:
    try:
        uses.enter_context(handle)
    except InvalidHandle:
        return False
    return True


@atexit.register
def _stop_all() -> None:
    for receiving in list(_running):
        receiving.stop()


# A process may fork while another thread inserts: the child's copy of the buffer would stay locked.
_forking = threading.Lock()
_held: "list[Receiving]" = []


def _before_fork() -> None:
    _forking.acquire()
    _held[:] = [receiving for receiving in _running if receiving.alive]
    for receiving in _held:
        receiving._receiver.hold()


def _release() -> None:
    for receiving in _held:
        receiving._receiver.release()
    _held.clear()
    _forking.release()


def _after_fork_in_child() -> None:
    count = len(_held)
    for receiving in _held:
        receiving._forked = True
    _release()
    if count:
        # Not through ROS, whose locks another thread may have held.
        logging.getLogger("tf2_ros").warning(
            f"Process {os.getpid()} is a fork of one with {count} TransformListener(s): no transforms will "
            "come in here. Let it be spawned instead, and make listeners of its own."
        )


os.register_at_fork(before=_before_fork, after_in_parent=_release, after_in_child=_after_fork_in_child)
