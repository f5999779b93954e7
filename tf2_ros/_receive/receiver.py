"""Receive a listener's transforms without an executor, as long as no code of a program handles them."""

import os
import weakref
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from types import MethodType
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import ROSClock
from rclpy.event_handler import EventHandler
from rclpy.node import Node
from rclpy.qos import HistoryPolicy
from rclpy.subscription import Subscription

from tf2_ros._forking import is_inherited
from tf2_ros._rcl import problem
from tf2_ros._rclpy import (
    context_was_shut_down,
    enter_handle,
    handle_pointer,
    hide_from_executors,
    report_incompatible_qos,
    set_subscription_callback,
    subscription_callback,
)
from tf2_ros._receive.inboxes import add_inbox, check_regularly, threads
from tf2_ros._receive.subscriptions import RclInbox

ENDLESS = 2**31 - 1  # messages that a queue without a limit holds

Call = Callable[[], object]


def can_receive() -> bool:
    """Whether the rcl that runs is known, so that listeners need no executor."""
    return problem() is None


def wake_executor(node: Any) -> None:
    """Have the executor of a node, if there is one, gather again what it waits for."""
    executor = node.executor if isinstance(node, Node) else None
    if executor is not None:
        executor.wake()


class ListenerGroup(ReentrantCallbackGroup):
    """
    The callback group of a listener. It keeps executors from its subscriptions until it is decided who takes
    their messages.

    It is reentrant, so that transforms arrive while another callback of the node waits for them. Entities
    that a program adds are executed as in any other group.
    """

    def __init__(self) -> None:
        super().__init__()
        self._undecided = True

    def can_execute(self, entity: Any) -> bool:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Whether an executor may run it."""
        return not (self._undecided and isinstance(entity, (Subscription, EventHandler)))

    def decide(self) -> None:
        """From now on, let executors take from the subscriptions."""
        self._undecided = False


class _Topic:
    """A subscription that a receiver takes from."""

    def __init__(self, subscription: Subscription, is_static: bool, collected: Callable[[Any], None]) -> None:
        self.is_static = is_static
        self.subscription = weakref.ref(subscription, collected)
        self.handle = subscription.handle
        self._uses = ExitStack()

    def use(self) -> int | None:
        """Keep the subscription from being destroyed. Return its address, or None if it was."""
        return handle_pointer(self.handle) if enter_handle(self.handle, self._uses) else None

    def release(self) -> None:
        """Let its owner destroy it."""
        self._uses.close()


class Receiver(RclInbox):
    """
    Inserts what arrives on a listener's subscriptions into a buffer when that is read.

    :param listener: a TransformListener, which has found that no code of a program handles the messages.
    :param subscriptions: at most one of each kind, and whether its transforms are static; all of class
        Subscription. Executors do not take from them, unless they are given back, which is for good.
    :param queue: the CallbackQueue of the node. It keeps this object until :meth:`close`, and is informed of
        what arrives.

    It ends with :meth:`stop`, the last of the subscriptions, the context or the interpreter; in a forked
    child it is dead. It keeps alive neither the listener nor the buffer nor the node.
    """

    def __init__(
        self,
        listener: Any,
        authority: str,
        subscriptions: Sequence[tuple[Subscription, bool]],
        queue: Any,
    ) -> None:
        node: Node = listener.node
        self._listener = weakref.ref(listener)
        self._node = weakref.ref(node)
        self._context = node.context
        self._clock_use = ExitStack()
        self._queue = queue
        self._process = os.getpid()
        self.set_up(authority, queue, listener._tf2_recording, listener._tf2_prefix)
        self._topics: dict[bool, _Topic] = {}  # by whether they are static
        self._given = {is_static for _, is_static in subscriptions}  # those not given back to executors
        threads.start()
        self.redirect()
        self._adopt(subscriptions)
        listener.group.decide()
        add_inbox(self)
        check_regularly(self)
        self._queue.inform(self.before_sleep)
        if not self._queue.in_sets:
            self.before_sleep(False)  # the node has moved meanwhile
        node.context.on_shutdown(self._context_ended)  # referred to weakly there

    @property
    def alive(self) -> bool:
        """Whether it still takes messages."""
        return not self.is_inherited() and bool(self._topics) and not context_was_shut_down(self._context)

    def is_inherited(self) -> bool:
        """Whether it is dead, because a parent process made it."""
        return is_inherited(self._process)

    def hand_over(self, calls: list[Call]) -> None:
        """Put them into the queue of the node."""
        self._queue.put_all(calls)

    def received(self, is_static: bool) -> tuple[int, int]:
        """Return how many messages of a topic it took, and the steady time of the last one in nanoseconds."""
        self.catch_up()
        return self.taken(is_static)

    def is_left_to_executors(self, is_static: bool) -> bool:
        """Whether executors take the messages of a topic."""
        return is_static not in self._given

    def redirect(self) -> None:
        """Fill the listener's buffer from now on; leave all to executors if that is not a plain one."""
        listener = self._listener()
        buffer = None if listener is None else listener._tf2_direct_buffer()
        if buffer is None:
            self._give_all_back()
        elif not self.fills(buffer):
            clock = getattr(buffer, "clock", None)
            use, pointer = ExitStack(), 0
            if isinstance(clock, ROSClock) and enter_handle(clock.handle, use):
                pointer = handle_pointer(clock.handle)
            self.fill(buffer, pointer)
            self._clock_use.close()
            self._clock_use = use

    def before_sleep(self, in_user_code: bool) -> None:
        """
        Prepare for an executor of the node that is about to sleep.

        :param in_user_code: whether user code called it, which continues if something has arrived.
        """
        if in_user_code:
            self.catch_up()  # which informs the executor
        if not self._queue.in_sets:
            # The middleware reports arrivals to only one of the two, by now to the executor (rclpy's
            # EventsExecutor). Those that it reported to this inbox must be taken here.
            self.catch_up()
            self._give_all_back()

    def stop(self) -> None:
        """End, and leave the subscriptions to their owner."""
        for is_static in list(self._topics):
            self._drop(is_static)
        self.close()

    def close(self) -> None:
        """Receive nothing more."""
        self._queue.inform_no_more(self.before_sleep)
        super().close()

    def __del__(self) -> None:
        """
        End, if nobody has called :meth:`stop`.

        Otherwise the collector, which calls no callbacks of weak references that are garbage themselves,
        could free the buffer and the clock while threads use them.
        """
        if "_topics" in self.__dict__ and not self.is_inherited():
            self.stop()

    def check(self) -> None:
        """Log incompatible publishers."""
        for topic in list(self._topics.values()):
            subscription: Any = topic.subscription()
            for handler in () if subscription is None else subscription.event_handlers:
                report_incompatible_qos(handler)

    def _adopt(self, subscriptions: Sequence[tuple[Subscription, bool]]) -> None:
        for subscription, is_static in subscriptions:
            collected = partial(_collected, weakref.ref(self), is_static)
            topic = self._topics[is_static] = _Topic(subscription, is_static, collected)
            # With its events: an executor that waits for one is also woken by each message.
            hide_from_executors(subscription)
            # The node calls this. Without weak references, only the collector would free the subscription.
            destroying: Any = subscription
            destroying.destroy = partial(_destroy, weakref.ref(subscription), weakref.ref(self), is_static)
            address = topic.use()
            if address is None:
                continue
            name, depth = subscription.topic_name, _queue_depth(subscription)
            try:
                self.subscribe(is_static, topic.handle, address, name, depth)
            except RuntimeError:
                # This middleware does not report arrivals, so the executor takes the messages.
                self._give_back(topic)

    def _drop(self, is_static: bool) -> bool:
        # Returns whether it was there, because several threads may do this.
        topic = self._topics.pop(is_static, None)
        if topic is not None:
            self.unsubscribe(is_static, self._queue.in_sets)
            topic.release()
        return topic is not None

    def _give_back(self, topic: _Topic) -> None:
        subscription: Any = topic.subscription()
        if not self._drop(topic.is_static):
            return
        self._given.discard(topic.is_static)
        if not self._topics:
            self.close()
        if subscription is not None:
            hide_from_executors(subscription, is_hidden=False)
            wake_executor(self._node())

    def _give_all_back(self) -> None:
        for topic in list(self._topics.values()):
            self._give_back(topic)

    def _context_ended(self) -> None:
        # Nothing arrives any more.
        if not self.is_inherited():
            self.stop()


def _queue_depth(subscription: Subscription) -> int:
    qos = subscription.qos_profile
    return ENDLESS if qos.history == HistoryPolicy.KEEP_ALL else max(1, qos.depth)


def _collected(reference: "weakref.ref[Receiver]", is_static: bool, _: Any) -> None:
    # The subscription was not destroyed; its node was dropped.
    receiver = reference()
    if receiver is not None and not receiver.is_inherited():
        receiver._drop(is_static)


def _destroy(
    destroyed: "weakref.ref[Subscription]", reference: "weakref.ref[Receiver]", is_static: bool
) -> None:
    """Destroy a subscription, after its receiver has stopped using it."""
    subscription, receiver = destroyed(), reference()
    if subscription is None or (receiver is not None and receiver.is_inherited()):
        return
    if receiver is not None and receiver._drop(is_static) and not receiver._topics:
        receiver.close()
    callback = subscription_callback(subscription)
    if isinstance(callback, MethodType):
        # It refers to the listener, and that to this: only the collector would free the buffer.
        set_subscription_callback(subscription, partial(_call_ended, weakref.WeakMethod(callback)))
    Subscription.destroy(subscription)


def _call_ended(callback: "weakref.WeakMethod[Any]", message: Any) -> None:
    # For programs that use the callback of a subscription again.
    method = callback()
    if method is not None:
        method(message)
