"""Call back when a message can be transformed, or was dropped."""

# Imported first, because it explains what to install if the imports below fail.
from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

import inspect
import itertools
import os
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, Generic, Protocol, TypedDict, TypeVar, overload

from geometry_msgs.msg import TransformStamped
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import await_or_execute
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from tf2_py._internal import FOR_EVER_NS, call_all, class_name, duration_ns, frame_name, printable
from tf2_py.typing import DurationLike, TimeoutLike
from tf2_ros._arguments import (
    has,
    is_a,
    is_names,
    kind_of,
    optional_timeout_ns,
    refuse_swapped,
    require_callable,
)
from tf2_ros._forking import FORKED, LiveObjects, is_inherited, refuse_inherited
from tf2_ros._nodes import node_has_ended
from tf2_ros._wait.callbacks import CallbackQueue, callback_queue, patience_ns
from tf2_ros._wait.filter_queue import FilterFailureReason, MessageStream, Needed, PendingMessages
from tf2_ros._wait.timers import deadlines
from tf2_ros.buffer import Buffer

__all__ = ["FilterFailureReason", "MessageFilter"]

# A warning is logged when NEARLY_ALL of SAMPLE messages were dropped, at most every WARN_EVERY_S.
SAMPLE = 20
NEARLY_ALL = 19
WARN_EVERY_S = 15.0


_Message = TypeVar("_Message")
_Topic = tuple[type[_Message], str, QoSProfile | int]


class _Filter(Protocol):
    """A filter of ``message_filters``."""

    def registerCallback(self, callback: Callable[..., None], /) -> object: ...


class _Statistics(TypedDict):
    received: int
    passed: int
    dropped: dict[str, int]
    cleared: int
    waiting: int


class MessageFilter(Generic[_Message]):
    """
    Keeps the messages of a topic until a buffer can transform them into the target frames, at their stamps.

    :param input: ``(message type, topic, qos)`` to subscribe to; or a filter of ``message_filters``, or any
        other object with a ``registerCallback``; or a subscription of rclpy, whose own callback remains; or
        None, if the program calls :meth:`add`. The messages must have a ``header``.
    :param buffer: the transforms.
    :param target_frames: a name, or several; a message passes when its frame can be transformed into all of
        them.
    :param queue_size: how many messages may wait; one more drops the oldest. 0: any number.
    :param node: the executor that spins it runs the callbacks. Before it is spun, and when it was not for
        5 s, a thread for callbacks runs them.
    :param buffer_timeout: how long a message may wait, in steady time. Zero: not at all. None: forever.
    :param tolerance: a finite duration; transforms must be available for the message's stamp and for this
        much later, for example the duration of a sweep. The ``tolerance`` of a lookup is something else: the
        lookup accepts an older transform. None: zero.
    :raises TypeError: ``buffer`` is not a Buffer, ``input`` is something else, its messages have no header,
        or a duration is something else.
    :raises ValueError: ``target_frames`` is empty, ``queue_size`` or ``tolerance`` is negative, or
        ``tolerance`` is infinite.

    A message whose stamp is 0 needs the latest time for which its transforms are available; ``tolerance``
    then has no effect. Each message passes once or is dropped once, in the order in which its transforms
    become available, or in which it is dropped. Callbacks run one after the other in the node's executor,
    even if another thread adds messages or inserts transforms. Only a subscription needs that executor. If
    callbacks or iterations rely on a subscription and nobody spins the node for 5 s, a warning is logged
    once; the representation shows it at once. What a callback
    raises is logged; in the main thread, other exceptions than an ``Exception`` end the spin.

    ``async for message, transform in filter`` gives the same messages, from the start of the iteration to
    :meth:`close`, or to the end of the node or its context, each with its transform into the first target
    frame. Messages that have passed are kept until they are taken, without a limit.

    It has the methods of a filter of ``message_filters`` and can be the input of one. The end of a ``with``
    block closes it.

    >>> from queue import Queue
    >>> from geometry_msgs.msg import PointStamped
    >>> from tf2_ros import Buffer, MessageFilter
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id, mount.transform.translation.x = "base_link", 0.3
    >>> point = PointStamped()
    >>> point.header.frame_id = "camera"
    >>> buffer, points = Buffer(), Queue()
    >>> with MessageFilter(None, buffer, "base_link", 100, node=node) as waiting:  # of a node that is spun
    ...     key = waiting.registerCallback(points.put)
    ...     waiting.add(point)
    ...     buffer.set_transform_static(mount, "example")
    ...     points.get(timeout=5) is point
    True
    """

    # The type of the messages is known from a topic's, or from another MessageFilter's.
    @overload
    def __init__(
        self,
        input: "_Topic[_Message] | MessageFilter[_Message]",
        buffer: Buffer,
        target_frames: str | Sequence[str],
        queue_size: int,
        *,
        node: Node,
        buffer_timeout: TimeoutLike | None = ...,
        tolerance: DurationLike | None = ...,
    ) -> None: ...

    @overload
    def __init__(
        self: "MessageFilter[Any]",
        input: Subscription | _Filter | None,
        buffer: Buffer,
        target_frames: str | Sequence[str],
        queue_size: int,
        *,
        node: Node,
        buffer_timeout: TimeoutLike | None = ...,
        tolerance: DurationLike | None = ...,
    ) -> None: ...

    def __init__(
        self,
        input: Any,
        buffer: Buffer,
        target_frames: str | Sequence[str],
        queue_size: int,
        *,
        node: Node,
        buffer_timeout: TimeoutLike | None = None,
        tolerance: DurationLike | None = None,
    ) -> None:
        refuse_swapped(
            "MessageFilter",
            input=(_is_input, input),
            buffer=(is_a(Buffer), buffer),
            target_frames=(is_names, target_frames),
            queue_size=(is_a(int), queue_size),
            node=(has("create_subscription"), node),
        )
        if not isinstance(buffer, Buffer):
            raise TypeError(f"buffer must be a tf2_ros.Buffer, not {type(buffer).__name__}")
        self.callbacks: dict[int, tuple[Callable[..., object], tuple[Any, ...]]] = {}
        self._node = node
        self._failure_callbacks: dict[int, tuple[Callable[..., object], tuple[Any, ...]]] = {}
        self._connections = itertools.count()
        self._streams: LiveObjects[MessageStream[tuple[_Message, TransformStamped]]] = LiveObjects()
        self._disconnect: Callable[[], None] | None = None
        self._closed = False
        self._process = os.getpid()
        self._counts_lock = threading.RLock()
        self._passed = self._cleared = 0
        self._sampled = self._sampled_dropped = 0
        self._warn_again_at = 0.0
        self._queue = callback_queue(node)
        self._kept: set[Any] = set()  # what awaits a message, and nothing else may refer to
        self._unspun: _UnspunWarning | None = None
        self._pending = PendingMessages(
            buffer,
            Needed(_names(target_frames), _tolerance_ns(tolerance)),
            _size(queue_size),
            optional_timeout_ns(buffer_timeout, "buffer_timeout"),
            self._announce,
        )
        try:
            if input is not None:
                self.connectInput(input)
        except BaseException:
            self.close()
            raise

    def add(self, message: _Message) -> None:
        """
        Add a message, from any thread; without effect after :meth:`close`.

        :param message: of any type with a ``header``.
        :raises TypeError: it has no header, or one without a frame and a time.
        """
        refuse_inherited(self, self._process)
        if self._closed:
            return
        header = getattr(message, "header", None)
        if not hasattr(header, "frame_id") or not hasattr(header, "stamp"):
            raise TypeError(f"{kind_of(message)} has no header with a frame and a time")
        self._pending.add(message)

    @overload
    def registerCallback(self, callback: Callable[[_Message], object]) -> int: ...

    @overload
    def registerCallback(self, callback: Callable[..., object], first: Any, /, *arguments: Any) -> int: ...

    def registerCallback(self, callback: Callable[..., object], *arguments: Any) -> int:
        """
        Call ``callback(message, *arguments)`` with each message that passes.

        :return: the key of the callback in the dictionary ``callbacks``; removing the entry removes the
            callback.
        """
        refuse_inherited(self, self._process)
        require_callable("registerCallback", callback)
        connection = next(self._connections)
        self.callbacks = {**self.callbacks, connection: (callback, arguments)}
        self._warn_if_unspun()
        return connection

    @overload
    def registerFailureCallback(self, callback: Callable[[_Message, FilterFailureReason], object]) -> int: ...

    @overload
    def registerFailureCallback(
        self, callback: Callable[..., object], first: Any, /, *arguments: Any
    ) -> int: ...

    def registerFailureCallback(self, callback: Callable[..., object], *arguments: Any) -> int:
        """
        Call ``callback(message, reason, *arguments)`` with each message that is dropped.

        :param callback: ``reason`` is a :class:`FilterFailureReason`.
        :return: a number, which no other callback of this filter has.
        """
        refuse_inherited(self, self._process)
        require_callable("registerFailureCallback", callback)
        connection = next(self._connections)
        self._failure_callbacks = {**self._failure_callbacks, connection: (callback, arguments)}
        self._warn_if_unspun()
        return connection

    def connectInput(
        self,
        input: "_Topic[_Message] | MessageFilter[_Message] | Subscription | _Filter",
    ) -> None:
        """
        Take messages from another input instead of the previous one.

        :param input: see the constructor; not None.
        :raises TypeError: it is something else, or its messages have no header.
        """
        refuse_inherited(self, self._process)
        connect = self._connector(input)
        if self._disconnect is not None:
            self._disconnect()
        self._disconnect = connect()
        self._warn_if_unspun()

    def setTargetFrames(self, target_frames: str | Sequence[str]) -> None:
        """
        Set the target frames, also for messages that wait already.

        :param target_frames: a name, or several.
        :raises TypeError: one of them is not a ``str``.
        :raises ValueError: there are no names, or one is empty.
        """
        refuse_inherited(self, self._process)
        self._pending.require(target_frames=_names(target_frames))

    def setTolerance(self, tolerance: DurationLike) -> None:
        """
        Set how much later than its stamp a message needs transforms, also for messages that wait already.

        :param tolerance: a finite duration.
        :raises TypeError: it is not a duration.
        :raises ValueError: it is negative or infinite.
        """
        refuse_inherited(self, self._process)
        self._pending.require(tolerance_ns=_tolerance_ns(tolerance))

    def setQueueSize(self, queue_size: int) -> None:
        """
        Set how many messages may wait. The oldest above that are dropped.

        :param queue_size: 0: any number.
        :raises ValueError: it is negative.
        """
        refuse_inherited(self, self._process)
        self._pending.limit(_size(queue_size))

    def clear(self) -> None:
        """Remove the messages that wait, and those for which no callback was called yet."""
        refuse_inherited(self, self._process)
        cleared = self._pending.clear()
        with self._counts_lock:
            self._cleared += cleared

    def close(self) -> None:
        """Take no more messages, remove those that wait, and end the iterations; may be called again."""
        if is_inherited(self._process):
            return
        self._closed = True
        if self._disconnect is not None:
            self._disconnect()
            self._disconnect = None
        self.clear()
        for stream in self._streams:
            stream.close()

    def __enter__(self) -> "MessageFilter[_Message]":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        name = class_name(type(self))
        if "_pending" not in self.__dict__:
            return f"<{name}: not initialised>"
        if is_inherited(self._process):
            return f"<{name}: {FORKED}>"
        counts = self.statistics()
        facts = [f"{counts[key]} {key}" for key in ("waiting", "passed")]
        facts.append(f"{sum(counts['dropped'].values())} dropped")
        if self._closed:
            facts.append("closed")
        elif not self._queue.is_spun():
            facts.append("node not spun")
        frames = printable(" and ".join(self._pending.needed.target_frames))
        return f"<{name}: into {frames}: {', '.join(facts)}>"

    def statistics(self) -> _Statistics:
        """
        Count the messages.

        :return: ``received``; ``passed`` to the callbacks; ``dropped``, a dictionary by the names of reasons;
            ``cleared``; and ``waiting``, which are all others.
        """
        refuse_inherited(self, self._process)
        with self._counts_lock:
            dropped = {reason.value: self._pending.ended[reason] for reason in FilterFailureReason}
            done = self._passed + sum(dropped.values()) + self._cleared
            received = self._pending.count
            return {
                "received": received,
                "passed": self._passed,
                "dropped": dropped,
                "cleared": self._cleared,
                "waiting": received - done,
            }

    def __aiter__(self) -> MessageStream[tuple[_Message, TransformStamped]]:
        refuse_inherited(self, self._process)
        stream: MessageStream[tuple[_Message, TransformStamped]] = MessageStream(
            partial(node_has_ended, self._node), self._kept
        )
        self._streams.add(stream)
        if self._closed:
            stream.close()
        self._warn_if_unspun()
        return stream

    def _warn_if_unspun(self) -> None:
        if self._unspun is not None and (self.callbacks or self._failure_callbacks or self._streams):
            self._unspun.rely()

    def _connector(self, input: Any) -> Callable[[], Callable[[], None]]:
        if isinstance(input, tuple) and len(input) == 3:
            if not isinstance(input[0], type):
                raise TypeError(f"input must be (message type, topic, qos), in this order, not {input!r}")
            if not hasattr(input[0], "header"):
                raise TypeError(f"messages of the type {input[0]!r} have no header with a frame and a time")
            return lambda: self._subscribe(*input)
        if hasattr(input, "registerCallback"):
            return lambda: self._follow_filter(input)
        if hasattr(input, "callback") and not getattr(input, "raw", False):
            return lambda: self._follow_subscription(input)
        raise TypeError(
            f"input must be (message type, topic, qos), a filter, a subscription that is not raw, or None, "
            f"not {input!r}"
        )

    def _subscribe(self, message_type: Any, topic: str, qos: Any) -> Callable[[], None]:
        # In a separate group, because messages must be counted even during a long callback.
        subscription = self._node.create_subscription(
            message_type, topic, self.add, qos, callback_group=MutuallyExclusiveCallbackGroup()
        )

        self._unspun = _UnspunWarning(self._node, subscription.topic_name, self._queue)

        def disconnect() -> None:
            self._unspun = None
            self._node.destroy_subscription(subscription)

        return disconnect

    def _follow_filter(self, input: Any) -> Callable[[], None]:
        connected = [True]

        def take(message: Any, *_: Any) -> None:
            # Filters of message_filters cannot remove a callback.
            if connected:
                self.add(message)

        input.registerCallback(take)
        return connected.clear

    def _follow_subscription(self, subscription: Any) -> Callable[[], None]:
        own = subscription.callback
        extended = _then_add(own, self.add)
        subscription.callback = extended
        if subscription in self._node.subscriptions:
            self._unspun = _UnspunWarning(self._node, subscription.topic_name, self._queue)

        def disconnect() -> None:
            self._unspun = None
            if subscription.callback is extended:
                subscription.callback = own

        return disconnect

    def _announce(self) -> bool:
        if self._closed or node_has_ended(self._node):
            return False
        self._queue.put(self._deliver)
        return True

    def _deliver(self) -> None:
        """Call back with the next outcome."""
        outcome = self._pending.next_outcome()
        if outcome is None:
            return  # removed by `clear`
        message, transform, reason, text = outcome
        self._warn_of_drops(message, reason, text)
        if reason is not None:
            failed = self._failure_callbacks.values()
            call_all([partial(callback, message, reason, *arguments) for callback, arguments in failed])
            return
        with self._counts_lock:
            self._passed += 1
        for stream in self._streams:
            stream.put((message, transform))
        passed = list(self.callbacks.values())
        call_all([partial(callback, message, *arguments) for callback, arguments in passed])

    def _warn_of_drops(self, message: Any, reason: FilterFailureReason | None, text: str) -> None:
        self._sampled += 1
        self._sampled_dropped += reason is not None
        if self._sampled < SAMPLE:
            return
        dropped, self._sampled, self._sampled_dropped = self._sampled_dropped, 0, 0
        if dropped < NEARLY_ALL or reason is None or time.monotonic() < self._warn_again_at:
            return
        self._warn_again_at = time.monotonic() + WARN_EVERY_S
        frames = printable(" ".join(self._pending.needed.target_frames))
        self._node.get_logger().warning(
            f"MessageFilter [target={frames}]: {dropped} of the last {SAMPLE} messages were dropped; the "
            f"last, from frame [{printable(message.header.frame_id)}], for {reason.value}. {text}".rstrip()
        )


class _UnspunWarning:
    """
    Logs one warning if nobody has spun the node for some seconds.

    It begins when something relies on the subscription, and must be kept as long as the subscription exists.
    """

    def __init__(self, node: Node, topic: str, queue: CallbackQueue) -> None:
        self._node = node
        self._names = (topic, node.get_fully_qualified_name())
        self._queue = queue
        self._spun_ns = 0  # steady time at which the node was last seen spun, or first relied on

    def rely(self) -> None:
        """Note that something relies on the messages from now on."""
        if not self._spun_ns:
            self._spun_ns = time.monotonic_ns()
            self._check_later()

    def over(self) -> bool:
        """Whether there is nothing to warn of any more, for ``deadlines``."""
        return node_has_ended(self._node)

    def expire(self) -> None:
        """Warn if nobody has spun the node for long; otherwise check again."""
        now_ns = time.monotonic_ns()
        if self._queue.is_spun():
            self._spun_ns = now_ns
        if now_ns - self._spun_ns < patience_ns():
            self._check_later()
            return
        topic, node = self._names
        self._node.get_logger().warning(
            f"A MessageFilter gets no messages of [{topic}], because nobody spins the node [{node}]. "
            f"Spin it in a thread, for example with rclpy.spin(node)."
        )

    def _check_later(self) -> None:
        deadlines.add(self._spun_ns + patience_ns(), self)


def _is_input(value: Any) -> bool:
    if isinstance(value, tuple):
        return len(value) == 3 and hasattr(value[0], "header")
    return hasattr(value, "registerCallback") or hasattr(value, "callback")


def _names(target_frames: str | Sequence[str]) -> tuple[str, ...]:
    if not isinstance(target_frames, Iterable):
        raise TypeError(
            f"target_frames must be the name of a frame, or several, not {type(target_frames).__name__}"
        )
    names = (target_frames,) if isinstance(target_frames, str) else tuple(target_frames)
    if not names:
        raise ValueError("there must be a target frame")
    names = tuple(frame_name(name, "target_frames").removeprefix("/") for name in names)
    if "" in names:
        raise ValueError("the name of a target frame must not be empty")
    return names


def _size(queue_size: int) -> int:
    if queue_size < 0:
        raise ValueError(f"queue_size must not be negative, it is {queue_size}")
    return queue_size


def _tolerance_ns(tolerance: DurationLike | None) -> int:
    tolerance_ns = 0 if tolerance is None else duration_ns(tolerance, "tolerance")
    if tolerance_ns < 0:
        raise ValueError(f"tolerance must not be negative, it is {tolerance_ns / 1e9} s")
    if tolerance_ns >= FOR_EVER_NS:
        raise ValueError("tolerance must be finite: no transform is available forever after a stamp")
    return tolerance_ns


def _then_add(callback: Callable[..., Any], add: Callable[[Any], None]) -> Callable[..., Any]:
    async def with_message(message: Any) -> None:
        await await_or_execute(callback, message)
        add(message)

    async def with_info(message: Any, info: Any) -> None:
        await await_or_execute(callback, message, info)
        add(message)

    # rclpy finds out in the same way how many arguments a callback takes.
    try:
        inspect.signature(callback).bind(object())
    except TypeError:
        return with_info
    return with_message
