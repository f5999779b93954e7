"""Owns the thread that takes what arrives on a listener's subscriptions, beside all executors."""

import atexit
import logging
import os
import threading
import time
import traceback
import weakref
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any

from rclpy.clock import ROSClock
from rclpy.event_handler import QoSSubscriptionEventType, UnsupportedEventTypeError
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind
from rclpy.subscription import Subscription

from tf2_py import BufferCore
from tf2_ros._forking import keep_for_ever
from tf2_ros._receive.arrivals import Arrivals, Completion
from tf2_ros._receive.callback_group import ListenerGroup, ReceivedSubscription, wake_executor
from tf2_ros._receive.callback_thread import callback_thread

Receiver: Any
try:
    # After rclpy, which loads the libraries that it needs.
    from tf2_ros._receive.loop import Receiver
except ModuleNotFoundError:
    Receiver = None  # there was nothing to build it with

__all__ = [
    "Receiving",
    "attribute_changed",
    "can_receive",
    "hand_over",
    "replay",
]

END_WAIT_S = 1.0
RETRY_S = 0.5

_running: "weakref.WeakSet[Receiving]" = weakref.WeakSet()


def can_receive() -> bool:
    """Whether the receiver could be built here."""
    return Receiver is not None


def attribute_changed() -> None:
    """Tell every receiver that an attribute was set which may concern it; none takes a message before."""
    for receiving in list(_running):
        receiving.changed()


def replay(buffer: BufferCore, until_ns: int) -> None:
    """
    Insert again what receivers took since the buffer's clock last moved forward.

    :param until_ns: the clock's time after its jump; what is stamped later is not inserted.
    """
    for receiving in list(_running):
        if receiving.fills(buffer):
            receiving.replay(until_ns)


def hand_over(buffer: BufferCore, completion: Completion) -> None:
    """Call this in the executor of a listener of the buffer, or in a thread for callbacks; not here."""
    for receiving in list(_running):
        if receiving.fills(buffer):
            receiving.arrivals.hand_over([completion])
            return
    callback_thread.put(completion)


class Receiving:
    """
    Takes what arrives on subscriptions into a buffer, in a thread of its own.

    :param node: whose executor is told.
    :param group: the callback group of the subscriptions.
    :param subscriptions: at most two, each with whether its transforms are static; all of class Subscription.
    :param choose: given one of these pairs, the buffer into which its messages go without Python; None where
        Python must see them, then the subscription is left to executors for good. It must hold neither node
        nor buffer. The types of what it looks at are `types()`.
    :param types: the types whose attributes `choose` looks at; :meth:`changed` is for those of objects.

    The thread ends with :meth:`stop`, with the last of the subscriptions, with the context and with the
    interpreter; a forked child has none. It keeps alive neither the buffer nor the node, and runs no code of
    a user.
    """

    def __init__(
        self,
        node: Node,
        authority: str,
        group: ListenerGroup,
        subscriptions: Sequence[tuple[Subscription, bool]],
        choose: Callable[[Subscription, bool], BufferCore | None],
        types: Callable[[], Sequence[type]],
    ) -> None:
        self._node = weakref.ref(node)
        self._authority = authority
        self._choose = choose
        self._types = types
        self._context = node.context.handle
        self._guard = GuardCondition(None, None, node.context)
        self.arrivals = Arrivals(node, group, [subscription for subscription, _ in subscriptions])
        self._sources = [
            _Source(number, subscription, is_static, self._subscription_gone)
            for number, (subscription, is_static) in enumerate(subscriptions)
        ]
        self._receiver: Any = None
        self._stopping = False
        self._ended = False
        self.forked = False  # whether the thread is that of a parent process
        # A daemon, so that the interpreter does not wait for it before it runs the exit handlers.
        self._thread = threading.Thread(target=self._run, name="tf2_ros receiver", daemon=True)
        for subscription, _ in subscriptions:
            ReceivedSubscription.adopt(subscription, node, self)
        group.decide()
        node.context.on_shutdown(self._context_ended)  # held weakly there
        node.add_waitable(self.arrivals)
        _running.add(self)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether it goes on."""
        return not self.forked and self._thread.is_alive()

    def fills(self, buffer: BufferCore) -> bool:
        """Whether the transforms go into this buffer."""
        return self._receiver is not None and self._receiver.fills(buffer)

    def changed(self) -> None:
        """Ask `choose` and `types` again before the next message is taken."""
        if self._receiver is not None:
            self._receiver.changed()
        self._wake(wait=False)

    def replay(self, until_ns: int) -> None:
        """See the function of this name."""
        self._receiver.replay(until_ns)

    def stop(self, *, wait: bool = True) -> None:
        """
        End the thread.

        :param wait: until it has ended, unless this is that thread.
        """
        wait = wait and not self._stopping
        self._stopping = True
        self._wake(wait)

    def after_fork(self) -> bool:
        """Be dead, in a forked child, without touching the middleware; whether the parent's still works."""
        self.forked = True
        # The thread of the parent may have been using them.
        keep_for_ever(self._guard.handle, self._receiver, *self._sources)
        self.arrivals.after_fork()
        return not self._ended

    def leave(self, subscription: Subscription) -> None:
        """Take no more from this subscription."""
        if self.forked:
            return
        for source in self._sources:
            if source.handle is subscription.handle:
                source.destroy()
                self.arrivals.stop_counting(source.number)
        self._sources = [source for source in self._sources if source.handle is not subscription.handle]
        if not self._sources:
            self.arrivals.close()
        self._wake(wait=not self._sources and not self._stopping)

    def _wake(self, wait: bool) -> None:
        if self.forked:
            return
        self._guard.trigger()
        if wait and self._thread is not threading.current_thread():
            self._thread.join(END_WAIT_S)

    def _subscription_gone(self, _: Any) -> None:
        # Nobody destroyed it: its node was dropped.
        self.changed()

    def _context_ended(self) -> None:
        # The context is locked meanwhile.
        self.stop(wait=False)

    def _run(self) -> None:
        while not self._stopping:
            try:
                if not self._serve():
                    break
            except Exception:
                get_logger("tf2_ros").error(f"No transforms for {RETRY_S} s: {traceback.format_exc()}")
                time.sleep(RETRY_S)
        self._ended = True

    def _serve(self) -> bool:
        """Work until something changes; whether there is more to do."""
        with ExitStack() as uses:
            clock = self._prepare(uses)
            sources = [source for source in self._sources if source.use(uses)]
            if not sources or not _use(self._context, uses):
                return False
            uses.enter_context(self._guard.handle)
            happened = self._receiver.run(
                self._context.pointer,
                self._guard.handle.pointer,
                clock,
                [source.as_tuple() for source in sources],
            )
            if happened is None:
                return False
            for source in sources:
                source.report_event(happened)
            return True

    def _prepare(self, uses: ExitStack) -> int:
        """Choose the buffer, and give back the subscriptions whose messages Python must see; its clock."""
        buffer = self._choose_buffer()
        clock = getattr(buffer, "clock", None)
        if not isinstance(clock, ROSClock) or not _use(clock.handle, uses):
            return 0
        pointer: int = clock.handle.pointer
        return pointer

    def _choose_buffer(self) -> BufferCore | None:
        while True:
            found = (self._chosen(source) for source in self._sources)
            buffer = next((one for one in found if one is not None), None)
            if buffer is not None:
                if not self.fills(buffer):
                    self._receiver = Receiver(buffer, self._authority, self.arrivals, self.arrivals.hand_over)
                # From here on a change is noticed, so what is found now holds.
                self._receiver.watch(self._types())
            chosen = [(source, self._chosen(source)) for source in self._sources]
            if all(one is None or one is buffer for _, one in chosen):
                for source, one in chosen:
                    if one is None:
                        self._give_back(source)
                return buffer

    def _chosen(self, source: "_Source") -> BufferCore | None:
        subscription = source.subscription()
        return None if subscription is None else self._choose(subscription, source.is_static)

    def _give_back(self, source: "_Source") -> None:
        subscription = source.subscription()
        if subscription is None:
            self._sources.remove(source)
            source.destroy()
        else:
            node = self._node()
            self.leave(subscription)
            subscription.give_back(node)
            wake_executor(node)


class _Source:
    """A subscription without its node, and what is to be told of it: publishers that it cannot hear."""

    def __init__(
        self, number: int, subscription: Subscription, is_static: bool, gone: Callable[[Any], None]
    ) -> None:
        self.number = number
        self.is_static = is_static
        self.subscription = weakref.ref(subscription, gone)
        self.handle = subscription.handle
        self._topic = subscription.topic_name
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

    def as_tuple(self) -> tuple[int, int, int, str, bool]:
        """It as the receiver takes it."""
        event = 0 if self._event is None else self._event.pointer
        return self.number, self.handle.pointer, event, self._topic, self.is_static

    def report_event(self, happened: list[int]) -> None:
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


def _after_fork_in_child() -> None:
    lost = sum([receiving.after_fork() for receiving in list(_running)])
    _running.clear()
    if lost:
        # Not through ROS, whose locks another thread may have held.
        logging.getLogger("tf2_ros").warning(
            f"Process {os.getpid()} is a fork of one with {lost} TransformListener(s): no transforms will "
            "come in here. Let it be spawned instead, and make listeners of its own."
        )


os.register_at_fork(after_in_child=_after_fork_in_child)
