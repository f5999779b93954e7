"""Receive a listener's transforms without an executor, because no user code handles them."""

import os
import weakref
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import ROSClock
from rclpy.qos import HistoryPolicy
from rclpy.subscription import Subscription

from tf2_ros._forking import is_inherited
from tf2_ros._rclpy import (
    context_was_shut_down,
    enter_handle,
    handle_pointer,
    hide_from_executors,
    report_incompatible_qos,
)
from tf2_ros._receive.inbox import Inbox
from tf2_ros._receive.inboxes import add_owner, check_regularly, start_threads
from tf2_ros._receive.subscriptions import Subscriptions
from tf2_ros._receive.topics import Topic

ENDLESS = 2**31 - 1  # messages that a queue without a limit holds


class ListenerGroup(ReentrantCallbackGroup):
    """
    The callback group of a listener.

    It is reentrant, so that transforms arrive while another callback of the node waits for them. While
    ``hides`` is set, executors skip the subscriptions that are made in it, before they first see them.
    """

    hides = False

    def add_entity(self, entity: Any) -> None:
        """Add an entity, which is a new one of the node."""
        if self.hides and isinstance(entity, Subscription):
            hide_from_executors(entity)
        super().add_entity(entity)


class Receiver:
    """
    Inserts what arrives on a listener's topics into a buffer when that is read: the owner of an inbox.

    :param listener: a TransformListener, which has found that no user code handles the messages.
    :param topics: those that it takes, whose subscriptions are hidden from executors.
    :param queue: the CallbackQueue of the node, which is informed of what arrives.

    It ends with :meth:`stop`, the last of the subscriptions, the context or the interpreter; in a forked
    child it is dead. The listener and the subscriptions keep it alive, and the buffer does not.
    """

    def __init__(self, listener: Any, topics: Sequence[Topic], queue: Any) -> None:
        self._listener = weakref.ref(listener)
        self._context = listener.node.context
        self._queue = queue
        self._process = os.getpid()
        self._topics: list[Topic] = []  # replaced, never changed
        self._source = Subscriptions(listener._tf2_recording, listener._tf2_prefix)
        self.inbox = Inbox(self._source, queue.hand_over)
        self.inbox.inform(queue)
        start_threads()
        for topic in topics:
            self._take(topic)
        add_owner(self)
        check_regularly(self)
        queue.sleepers.add(self)
        self.redirect()
        if not queue.in_sets:
            self.before_sleep(False)  # the node has moved meanwhile
        self._context.on_shutdown(self.stop)  # referred to weakly there

    @property
    def topics(self) -> list[Topic]:
        """The topics whose messages it takes now."""
        is_dead = is_inherited(self._process) or context_was_shut_down(self._context)
        return [] if is_dead else self._topics

    def redirect(self) -> None:
        """Fill the listener's buffer from now on; leave all to executors if that is not a plain one."""
        listener = self._listener()
        buffer = None if listener is None else listener._tf2_direct_buffer()
        if buffer is None:
            self._leave_to_executors()
        elif self._topics and not self.inbox.fills(buffer):
            self.inbox.fill(buffer)
            clock = getattr(buffer, "clock", None)
            if isinstance(clock, ROSClock):
                self._source.follow(clock.handle, handle_pointer(clock.handle))

    def before_sleep(self, in_user_code: bool) -> None:
        """Prepare for an executor of the node that is about to sleep; see ``Sleeper``."""
        if in_user_code:
            self.inbox.catch_up()  # which informs the executor
        if not self._queue.in_sets:
            # The middleware reports arrivals to only one of the two, by now to the executor (rclpy's
            # EventsExecutor). Those that it reported to this inbox must be taken here.
            self._source.is_told = False
            self.inbox.catch_up()
            self._leave_to_executors()

    def stop(self) -> None:
        """End, and leave the subscriptions to their owner."""
        if not is_inherited(self._process):
            self._topics = []
            self._queue.sleepers.discard(self)
            self.inbox.close()

    def __del__(self) -> None:
        """
        End, if nobody has called :meth:`stop`.

        Otherwise the collector, which calls no callbacks of weak references that are garbage themselves,
        could free the buffer and the clock while threads use them.
        """
        # Making __dict__ here would have the collector keep everything until its next run.
        if hasattr(self, "inbox"):
            self.stop()

    def _tf2_check(self) -> None:
        """Log incompatible publishers."""
        for topic in self._topics:
            subscription: Any = topic.subscription
            for handler in subscription.event_handlers:
                report_incompatible_qos(handler)

    def _take(self, topic: Topic) -> None:
        subscription: Any = topic.subscription
        uses = ExitStack()
        if not enter_handle(subscription.handle, uses):
            return  # another thread has destroyed it
        self._topics = [*self._topics, topic]
        subscription.destroy = partial(self._destroy, topic)  # the node calls this
        pointer, qos = handle_pointer(subscription.handle), subscription.qos_profile
        depth = ENDLESS if qos.history == HistoryPolicy.KEEP_ALL else max(1, qos.depth)
        try:
            self._source.subscribe(topic.arrivals, uses, pointer, topic.name, topic.is_static, depth)
        except RuntimeError:
            self._leave_to_executors()  # this middleware does not report arrivals

    def _leave_to_executors(self) -> None:
        topics, listener = self._topics, self._listener()
        self.stop()
        for topic in topics:
            subscription: Any = topic.subscription
            hide_from_executors(subscription, is_hidden=False)
        executor = None if listener is None else listener.node.executor
        if executor is not None:
            executor.wake()

    def _destroy(self, topic: Topic) -> None:
        """Destroy the subscription, after this has stopped using it."""
        if is_inherited(self._process):
            return
        self._source.unsubscribe(topic.arrivals)
        self._topics = [one for one in self._topics if one is not topic]
        if not self._topics:
            self.stop()
        subscription: Any = topic.subscription
        Subscription.destroy(subscription)
