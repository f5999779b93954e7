"""
The topics of listeners: take their messages without an executor where no user code handles them, and say what
was received on them, in errors, warnings and representations.
"""

import os
import time
import weakref
from collections.abc import Sequence
from functools import partial
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.qos import HistoryPolicy, QoSProfile

from tf2_py import BufferCore
from tf2_py._internal import log
from tf2_py.text import counted
from tf2_ros._fillers import ask_for_silence, note_filler
from tf2_ros._forking import LiveObjects, is_inherited
from tf2_ros._qos import is_latched
from tf2_ros._rclpy import (
    context_was_shut_down,
    event_handlers,
    handle_exists,
    is_ros_clock,
    on_destroy,
    report_event,
    watch_losses,
)
from tf2_ros._receive.inbox import Inbox, Informed
from tf2_ros._receive.subscriptions import Subscriptions, TopicArrivals
from tf2_ros._threads import add_owner, check_regularly

# A topic of dynamic transforms is called silent if nothing was received on it for this long. Most are sent
# ten times a second or more.
SILENT_S = 3
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
        self.arrivals = TopicArrivals()
        self._loss_handler: Any = None
        self._lost = 0  # on the way, as far as the middleware has reported it
        self._warned_of = 0, 0  # lost messages, as `lost` returns them
        self._warned_at = -LOSS_WARNING_S

    def begin(self, node: Any, subscription: Any) -> None:
        """Note the subscription, and have its lost messages counted."""
        self.subscription, self.name = subscription, subscription.topic_name
        self.context = getattr(node, "context", None)
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
        """Warn if messages were lost since the last warning."""
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
                f"newer ones have displaced them in the queue, whose depth is {depth}. Give the listener a "
                f"deeper one, for example {option}={max(10 * depth, 100)}",
            )
        if on_the_way:
            self._warn(
                on_the_way,
                "they did not reach the listener. Make listener and publishers reliable, and give the "
                "publishers deeper queues",
            )

    def _warn(self, count: int, why: str) -> None:
        log.logger("tf2_ros").warning(f"Lost {counted(count, 'message')} on {self.name}: {why}")


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
    :param call_queue: of the node; an executor is informed of what arrives.
    :param buffer: to fill, see :meth:`redirect`.

    It ends with :meth:`stop`, the last of the subscriptions, the context or the interpreter; in a forked
    child it is dead. The listener and the subscriptions keep it alive, and the buffer does not.
    """

    kind = "listener"

    def __init__(self, listener: Any, call_queue: Any, buffer: BufferCore | None) -> None:
        self._group: ListenerGroup = listener.group
        self._context = listener.node.context
        self._runner = runner = call_queue.runner
        self._process = os.getpid()
        # The destroyed ones remain hidden: an executor that has just met the event handler of one, and may
        # wait for it, raises InvalidHandle.
        self._topics = self._group.hidden = listener._tf2_listening.topics
        self._group.hides_all = False
        clock: Any = getattr(listener.buffer, "clock", None)
        handle = clock.handle if is_ros_clock(clock) else None
        recording = listener._tf2_listening.recording
        self._source = Subscriptions(recording is not None, handle)
        self.inbox = Inbox(self._source, call_queue.receive, recording, listener._tf2_listening.prefix)
        if isinstance(runner, Informed):
            self.inbox.inform(runner)
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
        if isinstance(runner, Informed):
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

    def listener_ended(self, waits: bool) -> None:
        """Do nothing: without its subscriptions, this ends."""

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


class Listening:
    """
    What belongs to a listener, for the modules that receive for it.

    Its fields have these values until the listener is made, and for good in a subclass that does not call
    ``__init__``.
    """

    def __init__(self) -> None:
        self.buffer: Any = None
        self.topics: Sequence[Topic] = ()
        self.prefix = ""
        self.recording: Any = None
        self.process: int | None = None
        self.owns_node = False
        self.spinner: Any = None  # the thread that spins the node
        self.call_queue: Any = None  # of the node; None: that is of a program's own kind
        # A Receiver, or what the buffer has in place of one, with the methods that the listener calls.
        # Another thread may replace it.
        self.receiver: Any = None


_listeners: LiveObjects[Any] = LiveObjects()  # of the class TransformListener
_watchers: LiveObjects[Any] = LiveObjects()


def watch_listeners(watcher: Any) -> None:
    """Call ``_tf2_check()`` of an object whenever a listener fills a buffer that it did not fill before."""
    _watchers.add(watcher)


def note_listener(listener: Any) -> None:
    """Note that a TransformListener fills its buffer from now on."""
    buffer = listener.buffer
    _listeners.add(listener)
    # A subclass that does not call __init__ may not have a node yet.
    note_filler(getattr(listener, "node", None), buffer, listener._tf2_listening.call_queue)
    if issubclass(type(buffer), BufferCore):  # isinstance believes a Mock(spec=Buffer)
        ask_for_silence(buffer, _silence)
    for watcher in _watchers:
        watcher._tf2_check()


def open_topics(buffer: object) -> list[Topic]:
    """The topics on which the listeners of a buffer can receive anything."""
    listeners = [one for one in _listeners if getattr(one, "buffer", None) is buffer]
    return [topic for listener in listeners for topic in listener._tf2_listening.topics if topic.is_open()]


def describe_topics(topics: Sequence[Topic]) -> str:
    """Describe the topics with a subscription of rclpy's."""
    return "; ".join([topic.describe() for topic in topics if topic.subscription is not None])


def _silence(buffer: object) -> tuple[str, str]:
    # What BufferCore._ask_for_silence expects.
    topics = [topic for topic in open_topics(buffer) if topic.is_own]
    return _silent(topics), _silent([topic for topic in topics if not topic.is_static])


def _silent(topics: Sequence[Topic]) -> str:
    """Describe the silent ones of these topics in a clause without commas; ``""`` if there are none."""
    # Several listeners may receive on one topic.
    lasts: dict[str, int] = {}
    for topic in topics:
        lasts[topic.name] = max(lasts.get(topic.name, 0), topic.arrivals.taken()[1])
    static = {topic.name for topic in topics if topic.is_static}
    parts = []
    for name, last_ns in lasts.items():
        silent_s = (time.monotonic_ns() - last_ns) // 10**9
        if last_ns == 0:
            parts.append(f"on {name}")
        elif silent_s >= SILENT_S and name not in static:  # static transforms are sent once
            parts.append(f"on {name} for {silent_s} s")
    return "nothing has been received " + " and ".join(parts) if parts else ""


# A forked child receives nothing through its parent's listeners, and may make its own for the same buffers.
os.register_at_fork(after_in_child=_listeners.clear)
