"""Receive a listener's transforms without an executor, as long as no code of a program handles them."""

import weakref
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import ROSClock
from rclpy.event_handler import EventHandler
from rclpy.node import Node
from rclpy.qos import HistoryPolicy
from rclpy.subscription import Subscription

from tf2_ros._forking import keep_for_ever
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


class ReceivedSubscription(Subscription):
    """
    A subscription that a receiver takes from, and no executor.

    ``tf2_receiver`` is informed of changes; None once the subscription was given back to executors.
    """

    tf2_receiver: Any
    tf2_ended: "weakref.WeakMethod[Any] | None" = None  # the callback, once it was destroyed

    @classmethod
    def adopt(cls, subscription: Any, receiver: Any) -> None:
        """Turn a subscription into one of this class."""
        subscription.tf2_receiver = receiver
        # With its events: an executor that waits for one is also woken by each message.
        hide_from_executors(subscription)
        subscription.__class__ = cls

    def give_back(self) -> None:
        """Let executors take from it."""
        self.tf2_receiver = None
        hide_from_executors(self, is_hidden=False)

    @property
    def callback(self) -> Any:
        """What is called with each message."""
        ended = None if self.tf2_ended is None else self.tf2_ended()
        return subscription_callback(self) if ended is None else ended

    @callback.setter
    def callback(self, value: Any) -> None:
        receiver = self.tf2_receiver
        if receiver is not None:
            receiver.catch_up()  # messages that arrived before the change go where they belonged
        set_subscription_callback(self, value)
        if receiver is not None:
            receiver.decide()

    def destroy(self) -> None:
        """Destroy it, after the receiver has stopped using it."""
        if self.tf2_receiver is not None:
            if self.tf2_receiver.forked:
                return
            self.tf2_receiver.drop_subscription(self)
            if self.tf2_ended is None:
                # It refers to the listener, and that to this, so only the collector would free the buffer.
                self.tf2_ended = weakref.WeakMethod(subscription_callback(self))
                set_subscription_callback(self, _ignore)
        super().destroy()


def _ignore(_: object) -> None:
    pass


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

    :param listener: a TransformListener. A subscription whose messages code of a program handles
        (``_tf2_direct_buffer`` is None, or ``_tf2_is_own`` false) is left to executors for good.
    :param subscriptions: at most one of each kind, and whether its transforms are static; all of class
        Subscription.
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
        self.forked = False  # whether it is that of a parent process
        self.set_up(authority, queue, listener._tf2_recording, listener._tf2_prefix)
        self._topics: dict[bool, _Topic] = {}  # by whether they are static
        threads.start()
        self._adopt(subscriptions)
        add_inbox(self)
        check_regularly(self)
        listener.group.decide()
        self._queue.inform(self.before_sleep)
        if not self._queue.in_sets:
            self.before_sleep(False)  # the node has moved meanwhile
        node.context.on_shutdown(self._context_ended)  # referred to weakly there

    @property
    def alive(self) -> bool:
        """Whether it still takes messages."""
        return not self.forked and bool(self._topics) and not context_was_shut_down(self._context)

    def hand_over(self, calls: list[Call]) -> None:
        """Put them into the queue of the node."""
        self._queue.put_all(calls)

    def received(self, is_static: bool) -> tuple[int, int]:
        """Return how many messages of a topic it took, and the steady time of the last one in nanoseconds."""
        self.catch_up()
        return self.taken(is_static)

    def decide(self) -> bool:
        """Find out who gets the messages; return whether this receiver takes any."""
        listener = self._listener()
        buffer = None if listener is None else listener._tf2_direct_buffer()
        for topic in tuple(self._topics.values()):
            subscription = topic.subscription()
            if (
                listener is None
                or buffer is None
                or subscription is None
                or not listener._tf2_is_own(subscription.callback, topic.is_static)
            ):
                self._give_back(topic)
        if not self._topics:
            return False
        if buffer is not None and not self.fills(buffer):
            clock = getattr(buffer, "clock", None)
            use, pointer = ExitStack(), 0
            if isinstance(clock, ROSClock) and enter_handle(clock.handle, use):
                pointer = handle_pointer(clock.handle)
            self.fill(buffer, pointer)
            self._clock_use.close()
            self._clock_use = use
        return True

    def before_sleep(self, in_user_code: bool) -> None:
        """
        Prepare for an executor of the node that is about to sleep.

        :param in_user_code: whether user code called it, which continues if something has arrived.
        """
        self.decide()
        if in_user_code:
            self.catch_up()  # which informs the executor
        if self._queue.in_sets:
            return
        # The middleware reports arrivals to only one of the two, by now to the executor (rclpy's
        # EventsExecutor). Those that it reported to this inbox must be taken here.
        self.catch_up()
        for topic in list(self._topics.values()):
            self._give_back(topic)

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
        if "_topics" in self.__dict__ and not self.forked:
            self.stop()

    def after_fork(self) -> bool:
        """End in a forked child, without touching the middleware; return whether the parent's still works."""
        self.forked = True
        works = bool(self._topics)
        for topic in self._topics.values():
            keep_for_ever(topic, topic.handle, topic.subscription())
        keep_for_ever(self)
        return works

    def drop_subscription(self, subscription: Subscription) -> None:
        """Take no more from this subscription."""
        if self.forked:
            return
        for topic in list(self._topics.values()):
            if topic.handle is subscription.handle:
                self._drop(topic.is_static)
        if not self._topics:
            self.close()

    def check(self) -> None:
        """Find out who gets the messages, and log incompatible publishers."""
        if not self.forked:
            self.decide()
            for topic in list(self._topics.values()):
                subscription: Any = topic.subscription()
                for handler in () if subscription is None else subscription.event_handlers:
                    report_incompatible_qos(handler)

    def _adopt(self, subscriptions: Sequence[tuple[Subscription, bool]]) -> None:
        for subscription, is_static in subscriptions:
            collected = partial(_collected, weakref.ref(self), is_static)
            self._topics[is_static] = _Topic(subscription, is_static, collected)
            ReceivedSubscription.adopt(subscription, self)
        self.decide()
        for subscription, is_static in subscriptions:
            topic = self._topics.get(is_static)
            address = None if topic is None else topic.use()
            if topic is None or address is None:
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
        if not self._topics:
            self.close()
        if subscription is not None:
            subscription.give_back()
            wake_executor(self._node())

    def _context_ended(self) -> None:
        # Nothing arrives any more.
        if not self.forked:
            self.stop()


def _queue_depth(subscription: Subscription) -> int:
    qos = subscription.qos_profile
    return ENDLESS if qos.history == HistoryPolicy.KEEP_ALL else max(1, qos.depth)


def _collected(reference: "weakref.ref[Receiver]", is_static: bool, _: Any) -> None:
    # The subscription was not destroyed; its node was dropped.
    receiver = reference()
    if receiver is not None and not receiver.forked:
        receiver._drop(is_static)
