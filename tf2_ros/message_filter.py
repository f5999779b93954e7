"""Owns message filters: where messages come from, who gets those that pass, and who hears of the others."""

import inspect
import itertools
import threading
import time
import weakref
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.duration import Duration
from rclpy.executors import await_or_execute
from rclpy.node import Node

from tf2_py._objects.printable import printable
from tf2_ros._forking import tell_of_fork
from tf2_ros._wait.handoff import Handoff
from tf2_ros._wait.message_stream import MessageStream
from tf2_ros._wait.pending_messages import FilterFailureReason, HeldMessages
from tf2_ros._wait.waiting import FOR_EVER_NS, duration_ns, timeout_ns
from tf2_ros.buffer import Buffer

__all__ = ["FilterFailureReason", "MessageFilter"]

# How many messages say whether nearly all are dropped, how many of them that is, and how often to say it.
SAMPLE = 20
NEARLY_ALL = 19
WARN_EVERY_S = 15.0


class MessageFilter:
    """
    Holds the messages of a topic until a buffer can carry them into the target frames, at their own time.

    :param input: ``(message type, topic, qos)`` to subscribe to; or a filter of ``message_filters``, or
        whatever else has its ``registerCallback``; or a subscription of rclpy, whose own callback stays; or
        None: then :meth:`add` is called by hand. The messages have a ``header``.
    :param buffer: holds the transforms.
    :param target_frames: a name, or several; a message passes when all of them can be reached.
    :param queue_size: how many messages may wait; one more drops the oldest. 0: any number.
    :param node: whoever spins it runs the callbacks.
    :param buffer_timeout: how long a message may wait, in steady time. Zero: not at all. None: for ever.
    :param tolerance: a finite duration; transforms must be there at the message's stamp and so much later.

    Each message passes once or is dropped once, in the order in which its transforms become complete, or it
    is lost for them. Callbacks run one after the other in the node's executor, also where another thread
    brings messages or transforms. ``async for message, transform in filter`` gives the same messages, from
    the start of the iteration to :meth:`close`, each with its transform into the first target frame. What
    has passed and is not taken yet is kept, however much it is.

    It has the shape of a filter of ``message_filters`` and can be the input of one.
    """

    def __init__(
        self,
        input: Any,
        buffer: Buffer,
        target_frames: str | Sequence[str],
        queue_size: int,
        *,
        node: Node,
        buffer_timeout: Duration | None = None,
        tolerance: Duration | None = None,
    ) -> None:
        if not isinstance(buffer, Buffer):
            raise TypeError(f"buffer must be a tf2_ros.Buffer, not {type(buffer).__name__}")
        self.callbacks: dict[int, tuple[Callable[..., None], tuple[Any, ...]]] = {}
        self._node = node
        self._target_frames = _names(target_frames)
        self._queue_size = _size(queue_size)
        self._timeout_ns = timeout_ns(buffer_timeout)
        self._tolerance_ns = _tolerance_ns(tolerance)
        self._failure_callbacks: dict[int, tuple[Callable[..., None], tuple[Any, ...]]] = {}
        self._connections = itertools.count()
        self._streams: weakref.WeakSet[MessageStream] = weakref.WeakSet()
        self._disconnect: Callable[[], None] | None = None
        self._closed = False
        self._counting = threading.RLock()
        self._received = self._passed = self._cleared = 0
        self._dropped = dict.fromkeys(FilterFailureReason, 0)
        self._sampled = self._sampled_dropped = 0
        self._warn_again_at = 0.0
        self._done = Handoff(node, self._deliver)
        self._held = HeldMessages(buffer, self._has_passed, self._has_dropped)
        self._configure()
        tell_of_fork(self)
        try:
            if input is not None:
                self.connectInput(input)
        except BaseException:
            self.close()
            raise

    def add(self, message: Any) -> None:
        """
        Put a message in, from any thread; nothing happens after :meth:`close`.

        :raises TypeError: it has no header.
        """
        if self._closed:
            return
        if not hasattr(message, "header"):
            raise TypeError(f"a {type(message).__name__} has no header that tells its frame and time")
        with self._counting:
            self._received += 1
        self._held.add(message)

    def registerCallback(self, callback: Callable[..., None], *arguments: Any) -> int:
        """
        Call ``callback(message, *arguments)`` with each message that passes; returns a number for it.

        It stands under this number in the dictionary ``callbacks``, and can be taken out there.
        """
        connection = next(self._connections)
        self.callbacks = {**self.callbacks, connection: (callback, arguments)}
        return connection

    def registerFailureCallback(self, callback: Callable[..., None], *arguments: Any) -> int:
        """Call ``callback(message, reason, *arguments)`` with each dropped message and its reason."""
        connection = next(self._connections)
        self._failure_callbacks = {**self._failure_callbacks, connection: (callback, arguments)}
        return connection

    def connectInput(self, input: Any) -> None:
        """
        Take messages from there, and no longer from where they came from before.

        :param input: as of the constructor, but not None.
        :raises TypeError: it is nothing to take messages from.
        """
        connect = self._connector(input)
        if self._disconnect is not None:
            self._disconnect()
        self._disconnect = connect()

    def setTargetFrames(self, target_frames: str | Sequence[str]) -> None:
        """Set the frame, or the frames, to reach; messages that wait wait for these from now on."""
        self._target_frames = _names(target_frames)
        self._configure()

    def setTolerance(self, tolerance: Duration) -> None:
        """Set for how much later than its stamp a message needs transforms; also for those that wait."""
        self._tolerance_ns = _tolerance_ns(tolerance)
        self._configure()

    def setQueueSize(self, queue_size: int) -> None:
        """Set how many messages may wait; 0: any number. The oldest above that are dropped."""
        self._queue_size = _size(queue_size)
        self._configure()

    def clear(self) -> None:
        """Forget the messages that wait, and what callbacks have not been told yet."""
        cleared = self._held.clear() + sum(reason is None for _, _, reason, _ in self._done.clear())
        with self._counting:
            self._cleared += cleared

    def close(self) -> None:
        """End: take no more messages, forget those that wait, end the iterations. It may be called twice."""
        self._closed = True
        if self._disconnect is not None:
            self._disconnect()
            self._disconnect = None
        self.clear()
        self._done.close()
        for stream in list(self._streams):
            stream.close()

    def after_fork(self) -> None:
        """Let nobody hold the lock in a forked child."""
        self._counting = threading.RLock()

    def statistics(self) -> dict[str, Any]:
        """
        Count the messages.

        :return: ``received``; ``passed`` to the callbacks; ``dropped``, by reason; ``cleared``; and
            ``waiting``, which are all others.
        """
        with self._counting:
            dropped = {reason.value: count for reason, count in self._dropped.items()}
            gone = self._passed + sum(dropped.values()) + self._cleared
            return {
                "received": self._received,
                "passed": self._passed,
                "dropped": dropped,
                "cleared": self._cleared,
                "waiting": self._received - gone,
            }

    def __aiter__(self) -> MessageStream:
        stream = MessageStream()
        self._streams.add(stream)
        if self._closed:
            stream.close()
        return stream

    def _configure(self) -> None:
        self._held.configure(self._target_frames, self._tolerance_ns, self._queue_size, self._timeout_ns)

    def _connector(self, input: Any) -> Callable[[], Callable[[], None]]:
        if isinstance(input, tuple) and len(input) == 3:
            if not hasattr(input[0], "header"):
                raise TypeError(f"messages of the type {input[0]!r} have no header that tells frame and time")
            return lambda: self._subscribe(*input)
        if hasattr(input, "registerCallback"):
            return lambda: self._follow(input)
        if hasattr(input, "callback") and not getattr(input, "raw", False):
            return lambda: self._listen_in(input)
        raise TypeError(
            f"input must be (message type, topic, qos), a filter, a subscription that is not raw, or None, "
            f"not {input!r}"
        )

    def _subscribe(self, message_type: Any, topic: str, qos: Any) -> Callable[[], None]:
        # A group of its own: a callback that takes long must not keep messages from being counted.
        subscription = self._node.create_subscription(
            message_type, topic, self.add, qos, callback_group=MutuallyExclusiveCallbackGroup()
        )

        def leave() -> None:
            self._node.destroy_subscription(subscription)

        return leave

    def _follow(self, input: Any) -> Callable[[], None]:
        connected = [True]

        def take(message: Any, *_: Any) -> None:
            # Filters of message_filters cannot be told to call no more.
            if connected:
                self.add(message)

        input.registerCallback(take)
        return connected.clear

    def _listen_in(self, subscription: Any) -> Callable[[], None]:
        theirs = subscription.callback
        ours = _after(theirs, self.add)
        subscription.callback = ours

        def leave() -> None:
            if subscription.callback is ours:
                subscription.callback = theirs

        return leave

    def _has_passed(self, message: Any, transform: Any) -> None:
        self._done.put((message, transform, None, ""))

    def _has_dropped(self, message: Any, reason: FilterFailureReason, text: str) -> None:
        with self._counting:
            self._dropped[reason] += 1
        self._done.put((message, None, reason, text))

    def _deliver(self, outcome: tuple[Any, Any, FilterFailureReason | None, str]) -> None:
        message, transform, reason, text = outcome
        self._watch(message, reason, text)
        if reason is not None:
            for callback, arguments in self._failure_callbacks.values():
                callback(message, reason, *arguments)
            return
        with self._counting:
            self._passed += 1
        for stream in list(self._streams):
            stream.put((message, transform))
        for callback, arguments in list(self.callbacks.values()):
            callback(message, *arguments)

    def _watch(self, message: Any, reason: FilterFailureReason | None, text: str) -> None:
        self._sampled += 1
        self._sampled_dropped += reason is not None
        if self._sampled < SAMPLE:
            return
        dropped, self._sampled, self._sampled_dropped = self._sampled_dropped, 0, 0
        if dropped < NEARLY_ALL or reason is None or time.monotonic() < self._warn_again_at:
            return
        self._warn_again_at = time.monotonic() + WARN_EVERY_S
        frames = printable(" ".join(self._target_frames))
        self._node.get_logger().warning(
            f"MessageFilter [target={frames}]: {dropped} of the last {SAMPLE} messages were dropped; the "
            f"last, from frame [{printable(message.header.frame_id)}], for {reason.value}. {text}".rstrip()
        )


def _names(target_frames: str | Sequence[str]) -> tuple[str, ...]:
    names = (target_frames,) if isinstance(target_frames, str) else tuple(target_frames)
    if not names:
        raise ValueError("there must be a target frame")
    return tuple(name.removeprefix("/") for name in names)


def _size(queue_size: int) -> int:
    if queue_size < 0:
        raise ValueError(f"queue_size must not be negative, it is {queue_size}")
    return queue_size


def _tolerance_ns(tolerance: Duration | None) -> int:
    tolerance_ns = 0 if tolerance is None else duration_ns(tolerance)
    if tolerance_ns < 0:
        raise ValueError(f"tolerance must not be negative, it is {tolerance_ns / 1e9} s")
    if tolerance_ns >= FOR_EVER_NS:
        raise ValueError("tolerance must be finite: no transform is there for ever after a stamp")
    return tolerance_ns


def _after(theirs: Callable[..., Any], add: Callable[[Any], None]) -> Callable[..., Any]:
    async def with_message(message: Any) -> None:
        await await_or_execute(theirs, message)
        add(message)

    async def with_info(message: Any, info: Any) -> None:
        await await_or_execute(theirs, message, info)
        add(message)

    # rclpy asks a callback in the same way what it wants.
    try:
        inspect.signature(theirs).bind(object())
    except TypeError:
        return with_info
    return with_message
