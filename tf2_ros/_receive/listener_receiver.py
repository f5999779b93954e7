# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Take the messages of listeners without an executor, where no user code handles them."""

import os
from collections.abc import Sequence
from functools import partial
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.qos import HistoryPolicy, QoSProfile

from tf2_py import BufferCore
from tf2_ros._process.background import add_owner
from tf2_ros._process.forking import is_inherited
from tf2_ros._process.inbox import Inbox, Observer
from tf2_ros._rclpy import (
    clock_handle,
    context_was_shut_down,
    event_handlers,
    on_destroy,
    report_event,
)
from tf2_ros._receive.listener_topics import Topic, describe_topics
from tf2_ros._receive.subscriptions import Subscriptions


class ListenerGroup(ReentrantCallbackGroup):
    """
    The callback group of a listener.

    It is reentrant, so that transforms arrive while another callback of the node waits for them.
    """

    hides_all = False  # while a listener subscribes
    hidden: Sequence[Topic] = ()  # whose subscriptions and their events executors skip

    # rclpy declares its own as Literal[True].
    def can_execute(self, entity: Any) -> bool:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Whether an executor may wait for an entity of the group now."""
        return not self.hides_all and not any(topic.has(entity) for topic in self.hidden)


def _depth(qos: QoSProfile) -> int:
    """How many messages its queue holds; 0 if it is not known."""
    # A profile that keeps all messages has a depth, too, which means nothing.
    return qos.depth if qos.history == HistoryPolicy.KEEP_LAST else 0


class Receiver:
    """
    Inserts what arrives on a listener's topics into a buffer when that is read: the owner of an inbox.

    :param listener: a TransformListener, which has found that no user code handles the messages.
    :param call_queue: of the node; an executor observes what arrives.
    :param buffer: to fill, see :meth:`redirect`.

    It ends with :meth:`stop`, the last of the subscriptions, the context or the interpreter; in a forked
    child it is dead. The listener and the subscriptions keep it alive, and the buffer does not.
    """

    def __init__(self, listener: Any, call_queue: Any, buffer: BufferCore | None) -> None:
        self._group: ListenerGroup = listener.group
        self._context = listener.node.context
        self._runner = runner = call_queue.runner
        self._process = os.getpid()
        # Destroyed subscriptions remain hidden: an executor that has just met the event handler of one, and
        # may wait for it, raises InvalidHandle.
        self._topics = self._group.hidden = listener._tf2_state.topics
        self._group.hides_all = False
        clock: Any = getattr(listener.buffer, "clock", None)
        recording = listener._tf2_state.recording
        self._source = Subscriptions(recording is not None, clock_handle(clock))
        self.inbox = Inbox(self._source, call_queue.hand_over, recording, listener._tf2_state.prefix)
        if isinstance(runner, Observer):
            self.inbox.add_observer(runner)
        try:
            for topic in self._topics:
                subscription = topic.subscription
                on_destroy(subscription, partial(self._destroy, topic))
                self._source.subscribe(
                    topic.arrivals,
                    subscription.handle,
                    topic.name,
                    topic.is_static,
                    _depth(subscription.qos_profile),
                )
        except RuntimeError:
            self._leave_to_executors()  # this middleware does not report arrivals
        if isinstance(runner, Observer):
            runner.receivers.add(self)  # only now: an inbox that yields must not subscribe afterwards
        add_owner(self)
        self.redirect(buffer)

    @property
    def topics(self) -> Sequence[Topic]:
        """The topics whose messages it takes now."""
        is_dead = is_inherited(self._process) or context_was_shut_down(self._context)
        return () if is_dead else [topic for topic in self._topics if topic.arrivals.is_received]

    def redirect(self, buffer: BufferCore | None) -> None:
        """Fill this buffer from now on; None: user code handles transforms, so leave all to executors."""
        self.inbox.catch_up()  # what arrived before goes into the buffer of before
        if buffer is None:
            self._leave_to_executors()
        else:
            self.inbox.fill(buffer)

    def describe(self) -> str:
        """Describe the topics, after what has arrived is inserted."""
        self.inbox.catch_up()
        return describe_topics(self._topics)

    def yield_to_events_executor(self) -> None:
        """Leave the messages to rclpy's ``EventsExecutor``, which has taken the node."""
        # The middleware reports arrivals to only one of the two, by now to the executor. Those that it
        # reported to this inbox must be taken here.
        self._source.has_reports = False
        self.inbox.catch_up()
        self._leave_to_executors()

    def stop(self) -> None:
        """End, and leave the subscriptions to their owner."""
        if not is_inherited(self._process):
            self.inbox.close()

    def _tf2_check(self) -> None:
        """End with the context; log publishers that do not fit."""
        if context_was_shut_down(self._context):
            self.stop()
        for topic in self.topics:
            for handler in event_handlers(topic.subscription):
                report_event(handler)

    def _leave_to_executors(self) -> None:
        self.stop()
        self._group.hidden = ()
        self._runner.wake()

    def _destroy(self, topic: Topic) -> None:
        """Destroy the subscription, after this has stopped using it."""
        if is_inherited(self._process):
            return
        self._source.unsubscribe(topic.arrivals)
        if not any(one.arrivals.is_received for one in self._topics):
            self.stop()
        topic.destroy()
