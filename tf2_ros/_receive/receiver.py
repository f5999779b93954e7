"""Receive a listener's transforms without an executor, because no user code handles them."""

import os
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import ROSClock
from rclpy.qos import HistoryPolicy
from rclpy.subscription import Subscription

from tf2_py import BufferCore
from tf2_ros._forking import is_inherited
from tf2_ros._rclpy import context_was_shut_down, enter_handle, report_incompatible_qos, wake
from tf2_ros._receive.inbox import Inbox
from tf2_ros._receive.inboxes import add_owner, check_regularly, start_threads
from tf2_ros._receive.subscriptions import Subscriptions
from tf2_ros._receive.topics import Topic

ENDLESS = 2**31 - 1  # messages that a queue without a limit holds


class ListenerGroup(ReentrantCallbackGroup):
    """
    The callback group of a listener.

    It is reentrant, so that transforms arrive while another callback of the node waits for them.
    """

    hidden: frozenset[Any] = frozenset()  # subscriptions and their events, which executors skip

    def can_execute(self, entity: Any) -> bool:
        """Whether an executor may wait for an entity of the group now."""
        return entity not in self.hidden


class Receiver:
    """
    Inserts what arrives on a listener's topics into a buffer when that is read: the owner of an inbox.

    :param listener: a TransformListener, which has found that no user code handles the messages.
    :param topics: those that it takes, and hides from executors. An executor that has seen a subscription
        before may take one more message, which the listener's callback inserts.
    :param queue: the CallbackQueue of the node, which is informed of what arrives.

    It ends with :meth:`stop`, the last of the subscriptions, the context or the interpreter; in a forked
    child it is dead. The listener and the subscriptions keep it alive, and the buffer does not.
    """

    def __init__(self, listener: Any, topics: Sequence[Topic], queue: Any) -> None:
        self._group: ListenerGroup = listener.group
        self._context = listener.node.context
        self._queue = queue
        self._process = os.getpid()
        self._topics: list[Topic] = []
        clock = getattr(listener.buffer, "clock", None)
        handle = clock.handle if isinstance(clock, ROSClock) else None
        self._source = Subscriptions(listener._tf2_recording, handle, listener._tf2_prefix)
        self.inbox = Inbox(self._source, queue.hand_over)
        self.inbox.inform(queue)
        start_threads()
        for topic in topics:
            self._take(topic)
        add_owner(self)
        check_regularly(self)
        queue.sleepers.add(self)
        self.redirect(listener._tf2_direct_buffer())
        if not queue.in_sets:
            self.before_sleep(False)  # the node has moved meanwhile
        self._context.on_shutdown(self.stop)  # referred to weakly there

    @property
    def topics(self) -> list[Topic]:
        """The topics whose messages it takes now."""
        is_dead = is_inherited(self._process) or context_was_shut_down(self._context)
        return [] if is_dead else self._topics

    def redirect(self, buffer: BufferCore | None) -> None:
        """Fill this buffer from now on; None: user code handles transforms, so leave all to executors."""
        self.inbox.catch_up()  # what arrived before goes into the buffer of before
        if buffer is None:
            self._leave_to_executors()
        elif self._topics:
            self.inbox.fill(buffer)

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
            self._set_topics([])
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

    def _set_topics(self, topics: list[Topic]) -> None:
        self._topics = topics  # never changed itself
        subscriptions: list[Any] = [topic.subscription for topic in topics]
        self._group.hidden = frozenset(
            [*subscriptions, *(h for one in subscriptions for h in one.event_handlers)]
        )

    def _take(self, topic: Topic) -> None:
        subscription: Any = topic.subscription
        uses = ExitStack()
        if not enter_handle(subscription.handle, uses):
            return  # another thread has destroyed it
        self._set_topics([*self._topics, topic])
        subscription.destroy = partial(self._destroy, topic)  # the node calls this
        qos = subscription.qos_profile
        depth = ENDLESS if qos.history == HistoryPolicy.KEEP_ALL else max(1, qos.depth)
        try:
            self._source.subscribe(
                topic.arrivals, uses, subscription.handle.pointer, topic.name, topic.is_static, depth
            )
        except RuntimeError:
            self._leave_to_executors()  # this middleware does not report arrivals

    def _leave_to_executors(self) -> None:
        self.stop()
        executor = self._queue.executor()
        if executor is not None:
            wake(executor)

    def _destroy(self, topic: Topic) -> None:
        """Destroy the subscription, after this has stopped using it."""
        if is_inherited(self._process):
            return
        self._source.unsubscribe(topic.arrivals)
        self._set_topics([one for one in self._topics if one is not topic])
        if not self._topics:
            self.stop()
        subscription: Any = topic.subscription
        Subscription.destroy(subscription)
