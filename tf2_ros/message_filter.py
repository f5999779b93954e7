# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Call back when a message can be transformed, or was dropped."""

import tf2_ros_cython._ros_requirement  # noqa: F401

import itertools
import os
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import TYPE_CHECKING, Any, Generic, Literal, Protocol, TypeAlias, TypedDict, overload

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile

from tf2_py import TransformException, stored_name
from tf2_py._internal import (
    FOR_EVER_NS,
    bool_of,
    class_name,
    duration_ns,
    errors,
    frame_name,
    is_invalid_name,
    log,
    policy_of,
    time_ns,
)
from tf2_py.printable import counted, printable
from tf2_py.typing import DurationLike, LookupPolicy, TypeVarTuple, Unpack
from tf2_ros._arguments import kind_of, optional_timeout_ns, require_callable
from tf2_ros._frame_prefix import frame_of, valid_prefix
from tf2_ros._nodes.ended_nodes import node_has_ended, require_node, suppress_at_end
from tf2_ros._process.background import background, check_regularly
from tf2_ros._process.forking import FORKED, LOCK, is_inherited, refuse_inherited
from tf2_ros._rclpy import destroy_subscription, is_node
from tf2_ros._registration import stamped_class
from tf2_ros._wait.call_runners import ExecutorRunner, call_queue_of
from tf2_ros._wait.filtered_messages import FilterCalls, FilteredMessage
from tf2_ros._wait.futures import WakingFuture
from tf2_ros.buffer import Buffer

__all__ = ["FilterFailureReason", "MessageFilter"]

# A warning is logged when this many messages were dropped and none passed, at most every WARN_EVERY_S.
MANY = 20
WARN_EVERY_S = 15.0

if TYPE_CHECKING:
    from typing_extensions import TypeVar

    _Message = TypeVar("_Message", default=Any)
else:
    from typing import TypeVar

    _Message = TypeVar("_Message")
_More = TypeVarTuple("_More")
_Topic = tuple[type[_Message], str, QoSProfile | int]
_Callback = tuple[Callable[..., object], tuple[Any, ...]]


class _Filter(Protocol):
    """A filter of ``message_filters``."""

    def registerCallback(self, callback: Callable[..., None], /) -> object: ...


class _Statistics(TypedDict):
    received: int
    passed: int
    dropped: dict[str, int]
    cleared: int
    waiting: int


class FilterFailureReason(str, Enum):
    """
    Why a message filter dropped a message.

    - ``OUT_THE_BACK``: its transform is not available, and the buffer refuses data of its time as too old.
    - ``EMPTY_FRAME_ID``: its header has no frame_id.
    - ``NO_TRANSFORM_FOUND``: the name of its frame is invalid; its stamp plus ``tolerance`` exceeds the
      latest possible stamp; the transform was not available and ``buffer_timeout`` is zero; or a limit of
      ``policy`` is for a frame that is unknown or not a child.
    - ``QUEUE_FULL``: it was the oldest message when the queue overflowed.
    - ``TIMEOUT``: its transform was not available in time.

    >>> from geometry_msgs.msg import PointStamped
    >>> from tf2_ros import Buffer, FilterFailureReason, MessageFilter
    >>> reasons = []
    >>> with MessageFilter(None, Buffer(), "base_link", 100, node=node) as waiting:
    ...     key = waiting.registerFailureCallback(lambda message, reason: reasons.append(reason))
    ...     waiting.add(PointStamped())
    >>> reasons == [FilterFailureReason.EMPTY_FRAME_ID]
    True
    """

    OUT_THE_BACK = "OUT_THE_BACK"
    EMPTY_FRAME_ID = "EMPTY_FRAME_ID"
    NO_TRANSFORM_FOUND = "NO_TRANSFORM_FOUND"
    QUEUE_FULL = "QUEUE_FULL"
    TIMEOUT = "TIMEOUT"


_Outcome: TypeAlias = TransformStamped | FilterFailureReason


class MessageFilter(Generic[_Message]):
    """
    Keeps the messages of a topic until a buffer can transform them into the target frames, at their stamps.

    :param input: ``(message type, topic, qos)`` to subscribe to; or a filter of ``message_filters``, or any
        other object with a ``registerCallback``; or None, if the program calls :meth:`add`. The messages must
        have a ``header``.
    :param buffer: the buffer with the transforms.
    :param target_frames: a name, or several; a message passes when its frame can be transformed into all of
        them. As in tf2, this is tried after each insert. A transform that was available once counts as
        available, even if the buffer drops it while the message waits for other target frames.
    :param queue_size: how many messages may wait; one more drops the oldest. 0: any number.
    :param node: the executor that spins it takes the messages of a topic, and runs the callbacks for
        transforms that a listener receives.
    :param buffer_timeout: how long a message may wait, in steady time. Zero: not at all. None: forever.
    :param tolerance: a finite duration; transforms must be available for the message's stamp and for this
        much later, for example the duration of a sweep. None: zero. (The ``tolerance`` of a lookup differs:
        it accepts an older transform.)
    :param prefix: put before the frames of the messages, as in
        :meth:`~tf2_ros.BufferInterface.transform`; not before ``target_frames``.
    :param policy: what the lookups of the messages accept: a :class:`tf2_py.typing.LookupPolicy`, such as
        ``{"tolerance": 0.5}``. Its ``max_age`` limits only messages whose stamp is 0; all their transforms
        are fresh when the last one arrives. A message between two samples that are further apart than
        ``max_gap`` waits until a sample between them arrives, until ``buffer_timeout``, or until the buffer
        would refuse such a sample (``OUT_THE_BACK``).
    :raises TypeError: ``buffer`` is not a Buffer, ``input`` is none of these, its messages have no header, a
        duration is not a duration or a number, or ``policy`` has a key that a LookupPolicy lacks.
    :raises ValueError: ``target_frames`` is empty, a name or ``prefix`` is invalid, ``queue_size``,
        ``tolerance`` or a limit of ``policy`` is negative, or ``tolerance`` is infinite.

    A message whose stamp is 0 needs the latest time for which its transforms are available; ``tolerance``
    then has no effect. Each message passes once or is dropped once, in the order in which its transforms
    become available, or in which it is dropped. An ``Exception`` of a callback is logged.

    If a listener receives the transform, callbacks run in the executor that spins ``node``. If this program
    inserts it, they run inside ``set_transform``; if it is available already, inside :meth:`add`. The page
    "Callbacks, threads and executors" of the documentation has all cases.

    ``async for message, transform in filter`` yields the same messages, from the start of the iteration to
    :meth:`close`, or to the end of the node or its context, each with its transform into the first target
    frame. An executor has to spin the node if the messages come from a topic, or if there are callbacks, too.
    Messages that have passed are kept until they are taken, without a limit.

    It has the methods of a filter of ``message_filters`` and can be the input of one. The end of a ``with``
    block closes it.

    >>> from geometry_msgs.msg import PointStamped
    >>> from tf2_ros import Buffer, MessageFilter
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id = "base_link"
    >>> mount.transform.translation.x = 0.3
    >>> point = PointStamped()
    >>> point.header.frame_id = "camera"
    >>> buffer, points = Buffer(), []
    >>> with MessageFilter(None, buffer, "base_link", 100, node=node) as waiting:
    ...     key = waiting.registerCallback(points.append)
    ...     waiting.add(point)
    ...     buffer.set_transform_static(mount, "example")
    ...     points == [point]
    True
    """

    def __init__(
        self,
        # The type of the messages is known from a topic's, or from another MessageFilter's.
        input: "_Topic[_Message] | MessageFilter[_Message] | _Filter | None",
        buffer: Buffer,
        target_frames: str | Sequence[str],
        queue_size: int,
        *,
        node: Node,
        buffer_timeout: DurationLike | None = None,
        tolerance: DurationLike | None = None,
        prefix: str = "",
        policy: LookupPolicy | None = None,
    ) -> None:
        if not issubclass(type(buffer), Buffer):  # isinstance believes a Mock(spec=Buffer)
            raise TypeError(f"buffer: expected a tf2_ros.Buffer, got {type(buffer).__name__}")
        require_node("MessageFilter", node, "create_subscription")
        self._calls = FilterCalls(FilterFailureReason)
        self.callbacks: dict[int, _Callback] = self._calls.callbacks
        self._connections = itertools.count()
        self._buffer, self._node = buffer, node
        self._call_queue = call_queue_of(node)
        self._subscription: Any = None
        self._closed = False
        self._process = os.getpid()
        self._prefix = valid_prefix(prefix)
        self._frames = _names(target_frames)
        # Each target frame, and how much later than its stamp a message needs its transform.
        margins_ns = sorted({0, _tolerance_ns(tolerance)})
        self._needed = [(frame, margin_ns) for margin_ns in margins_ns for frame in self._frames]
        if queue_size < 0:
            raise ValueError(f"queue_size: expected 0 or more, got {queue_size}")
        self._queue_size = queue_size
        self._timeout_ns = optional_timeout_ns(buffer_timeout, "buffer_timeout")
        self._policy_of_latest, self._policy = _policies(policy)
        if self._policy_of_latest is not None and self._policy_of_latest.judges_age:
            check_regularly(buffer)
        self._warn_again_at = 0.0
        self._unserved_from_ns = time.monotonic_ns()
        self._has_warned_of_node = False
        self._connect(input)
        if self._subscription is not None and is_node(node):
            check_regularly(self)

    def add(self, message: _Message) -> None:
        """
        Add a message, from any thread; without effect after :meth:`close`.

        :param message: of any type with a ``header``.
        :raises TypeError: ``message`` has no header with ``frame_id`` and ``stamp``.
        :raises ValueError: the name of its frame contains a NUL character.
        """
        refuse_inherited(self, self._process)
        if self._closed:
            return
        header: Any = getattr(message, "header", None)
        if not hasattr(header, "frame_id") or not hasattr(header, "stamp"):
            stamped = stamped_class(type(message))
            advice = f"; {stamped} has one" if stamped else ""
            text = f"message: expected a header with frame_id and stamp, got {kind_of(message)}{advice}"
            raise TypeError(text)
        frame_name(header.frame_id, "header.frame_id")
        frame = frame_of(header, self._prefix) if self._prefix else stored_name(header.frame_id)
        stamp_ns = time_ns(header.stamp, "header.stamp")
        queued = FilteredMessage(
            self._calls, self._call_queue, message, frame, stamp_ns, self._outcome, self._warn_of_drops
        )
        try:
            self._calls.waiting[queued] = None
            self._begin(queued)
            if self._closed:  # meanwhile, by another thread
                queued.cancel()
        except BaseException:
            queued.cancel()  # nothing may be left that waits for nothing
            raise

    def registerCallback(
        self, callback: "Callable[[_Message, Unpack[_More]], object]", *arguments: "Unpack[_More]"
    ) -> int:
        """
        Call ``callback(message, *arguments)`` with each message that passes.

        :param callback: the function; the class describes where it runs.
        :param arguments: passed to it after the message.
        :return: the key of the callback in the dictionary ``callbacks``; removing the entry removes the
            callback.
        :raises TypeError: ``callback`` cannot be called.
        """
        connection = self._connect_callback("registerCallback", callback)
        self.callbacks[connection] = callback, arguments
        return connection

    @overload
    def registerFailureCallback(
        self,
        callback: "Callable[[_Message, FilterFailureReason, Unpack[_More]], object]",
        *arguments: "Unpack[_More]",
        with_text: Literal[False] = ...,
    ) -> int: ...

    @overload
    def registerFailureCallback(
        self,
        callback: "Callable[[_Message, FilterFailureReason, str, Unpack[_More]], object]",
        *arguments: "Unpack[_More]",
        with_text: Literal[True],
    ) -> int: ...

    def registerFailureCallback(
        self, callback: Callable[..., object], *arguments: "Unpack[_More]", with_text: bool = False
    ) -> int:
        """
        Call ``callback(message, reason, *arguments)`` with each message that is dropped.

        :param callback: ``reason`` is a :class:`FilterFailureReason`.
        :param with_text: call ``callback(message, reason, text, *arguments)``. The text is that of the error
            that a lookup raised when the message was dropped: it contains the frames and the missing data.
        :return: a number that identifies the callback among those of this filter.
        :raises TypeError: ``callback`` cannot be called, or ``with_text`` is not a bool.
        """
        has_text = bool_of(with_text, "with_text")
        connection = self._connect_callback("registerFailureCallback", callback)
        self._calls.failure_callbacks[connection] = callback, arguments, has_text
        return connection

    def _connect_callback(self, name: str, callback: Any) -> int:
        refuse_inherited(self, self._process)
        require_callable(name, callback)
        return next(self._connections)

    def clear(self) -> None:
        """Remove the waiting messages, and those whose callbacks were not called yet."""
        refuse_inherited(self, self._process)
        for queued in list(self._calls.waiting):
            queued.cancel()

    def close(self) -> None:
        """Stop taking messages, remove the waiting ones, and end the iterations; may be called again."""
        if is_inherited(self._process):
            return
        self._closed = True
        if self._subscription is not None:
            destroy_subscription(self._node, self._subscription)
            self._subscription = None
        self.clear()
        for stream in self._calls.streams():
            stream.arrival.end()

    def __enter__(self) -> "MessageFilter[_Message]":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        name = class_name(type(self))
        frames = printable(" and ".join(self._frames))
        if is_inherited(self._process):
            return f"<{name}: into {frames}: {FORKED}>"
        counts = self.statistics()
        dropped = sum(counts["dropped"].values())
        facts = (
            f"{counts['received']} received, {counts['waiting']} waiting, {counts['passed']} passed, "
            f"{dropped} dropped"
        )
        return f"<{name}: into {frames}: {facts}{', closed' if self._closed else ''}>"

    def statistics(self) -> _Statistics:
        """
        Count the messages.

        :return: ``received``; ``passed`` to the callbacks; ``dropped``, a dictionary by the names of reasons;
            ``cleared``; and ``waiting``, which are all others.
        """
        refuse_inherited(self, self._process)
        counts: _Statistics = self._calls.statistics()
        return counts

    def __aiter__(self) -> "MessageStream[_Message]":
        refuse_inherited(self, self._process)
        stream = MessageStream(self)
        self._calls.add_stream(stream)
        return stream

    def _new_arrival(self) -> WakingFuture[None]:
        return WakingFuture(self._has_ended, self._buffer._tf2_kept)

    def _has_ended(self) -> bool:
        refuse_inherited(self, self._process)
        return self._closed or node_has_ended(self._node)

    def _connect(self, input: Any) -> None:
        if isinstance(input, tuple) and len(input) == 3:
            message_type, topic, qos = input
            if not hasattr(message_type, "header"):
                stamped = stamped_class(message_type)
                advice = f"; {stamped} has one" if stamped else ""
                raise TypeError(
                    "input: expected (message type, topic, qos), in this order, and a type with a header, "
                    f"got {input!r}{advice}"
                )
            # In the group of the calls, so that no two threads of an executor call back at the same time.
            runner, options = self._call_queue.runner, {}
            if isinstance(runner, ExecutorRunner):
                options["callback_group"] = runner.callback_group
            self._subscription = self._node.create_subscription(message_type, topic, self.add, qos, **options)
        elif register := getattr(input, "registerCallback", None):
            register(lambda message, *_: self.add(message))
        elif input is not None:
            raise TypeError(f"input: expected (message type, topic, qos), a filter, or None, got {input!r}")

    def _tf2_check(self) -> None:
        """Warn, once, if the topic is published but nothing spins the node, which would take its messages."""
        if self._closed or self._has_warned_of_node or self._call_queue.has_ended():
            return
        with suppress_at_end(self._node):
            topic = self._subscription.topic_name
            if self._call_queue.is_served() or not self._node.count_publishers(topic):
                self._unserved_from_ns = time.monotonic_ns()
            elif self._call_queue.is_late(self._unserved_from_ns):
                self._has_warned_of_node = True
                self._warn_that_nobody_spins(topic)

    def _warn_that_nobody_spins(self, topic: str) -> None:
        frames, waited_ns = printable(" ".join(self._frames)), time.monotonic_ns() - self._unserved_from_ns
        why = self._call_queue.runner.why_late(self._node.get_fully_qualified_name())
        log.logger("tf2_ros").warning(
            f"MessageFilter [target={frames}] has taken no message of {printable(topic)} for "
            f"{waited_ns / 1e9:.0f} s: {why}"
        )

    def _begin(self, queued: FilteredMessage) -> None:
        stamp_ns = queued.stamp_ns
        # The latest time, 0, has no later one.
        needed = [(frame, stamp_ns + ns) for frame, ns in self._needed if stamp_ns or ns == 0]
        may_wait = self._timeout_ns is None or self._timeout_ns > 0
        missing = FilterFailureReason.NO_TRANSFORM_FOUND
        policy = self._policy if stamp_ns else self._policy_of_latest
        outcome: _Outcome | None
        text: str | None = None
        try:
            outcome = queued.at_once(self._buffer, needed, policy)
            if outcome is None:
                queued.begin(self._buffer, needed, policy)
        except (TransformException, OverflowError, ValueError) as error:
            outcome, text = missing if queued.frame else FilterFailureReason.EMPTY_FRAME_ID, str(error)
        else:
            if outcome is None:
                outcome, text = self._outcome(queued, None if may_wait else missing)
        if outcome is not None:
            # The transform of this one may have completed earlier ones, whose callbacks wait for an executor.
            while (oldest := self._calls.oldest()) not in (None, queued) and oldest.over():
                oldest()
            queued.end(outcome, text)
        elif self._timeout_ns is not None:
            background.expire_at(time.monotonic_ns() + self._timeout_ns, queued)
        while 0 < self._queue_size < len(self._calls.waiting):
            oldest = self._calls.oldest()
            if oldest is None:
                break  # another thread has ended some
            # What it lacked may have been received without having been reported.
            oldest.end(*self._outcome(oldest, FilterFailureReason.QUEUE_FULL))

    def _outcome(
        self, queued: FilteredMessage, otherwise: FilterFailureReason | None
    ) -> tuple[_Outcome | None, str | None]:
        """
        What a message ends with now, or None if it waits; and what is said if it is dropped.

        :param otherwise: the reason to drop it if it lacks a transform.
        """
        lack = ""
        outcome: Any = queued.outcome()
        if outcome is None and otherwise is not None:
            # An insert that is under way may not have tried it yet; `lack` finishes that.
            lack = queued.lack()
            outcome = (None if lack else queued.outcome()) or otherwise
        if isinstance(outcome, BaseException):
            refused: tuple[_Outcome, str] = self._calls.refused(outcome)
            return refused
        return outcome, self._text(outcome, lack)

    def _text(self, outcome: _Outcome | None, lack: str) -> str | None:
        """What is said of a message that is dropped now; None: it is not, or nobody wants to know."""
        if not isinstance(outcome, FilterFailureReason) or not self._calls.wants_text():
            return None
        if outcome is FilterFailureReason.QUEUE_FULL:
            return f"Another message has arrived while {counted(self._queue_size, 'message')} waited: {lack}"
        if outcome is FilterFailureReason.TIMEOUT:
            return errors.timed_out(lack, self._timeout_ns or 0)
        return lack

    def _warn_of_drops(self, queued: FilteredMessage, reason: FilterFailureReason, text: str | None) -> None:
        dropped_in_a_row = self._calls.dropped_in_a_row
        if dropped_in_a_row < MANY or time.monotonic() < self._warn_again_at:
            return
        self._warn_again_at = time.monotonic() + WARN_EVERY_S
        frames, lack = printable(" ".join(self._frames)), text or queued.lack()
        self._node.get_logger().warning(
            f"MessageFilter [target={frames}]: the last {dropped_in_a_row} messages were dropped; the "
            f"newest, from frame [{printable(queued.frame)}], because of {reason.value}. {lack}".rstrip()
        )


class MessageStream(Generic[_Message]):
    """
    An asynchronous iterator over the messages of a filter, which any thread appends to ``items``.

    It ends after the last one when the filter was closed, or with its node. If several iterate, each item is
    given to one of them.
    """

    def __init__(self, filter: MessageFilter[_Message]) -> None:
        self._filter = filter
        self.items: deque[tuple[_Message, TransformStamped]] = deque()
        self.arrival = filter._new_arrival()  # all that iterate await it
        check_regularly(self)

    def _tf2_check(self) -> None:
        """Wake those that await after the end of the node."""
        if self._filter._has_ended():
            self.arrival.end()

    def __aiter__(self) -> "MessageStream[_Message]":
        return self

    async def __anext__(self) -> tuple[_Message, TransformStamped]:
        while True:
            with LOCK:
                if self.arrival.has_ended():  # or what awaited it was cancelled
                    self.arrival = self._filter._new_arrival()
                arrival = self.arrival
            # First this, then the check; who appends an item does this in the opposite order.
            try:
                return self.items.popleft()
            except IndexError:
                if self._filter._has_ended():
                    raise StopAsyncIteration from None
                await arrival


def _names(target_frames: str | Sequence[str]) -> tuple[str, ...]:
    given = (target_frames,) if isinstance(target_frames, str) else target_frames
    names = tuple(stored_name(frame_name(name, "target_frames")) for name in given)
    if not names:
        raise ValueError("target_frames: expected at least one frame, got none")
    for name in names:
        if is_invalid_name(name):
            raise ValueError(
                "target_frames: expected names that are not empty and do not begin with '/', got "
                f"[{printable(name)}]"
            )
    return names


def _tolerance_ns(tolerance: DurationLike | None) -> int:
    tolerance_ns = 0 if tolerance is None else duration_ns(tolerance, "tolerance")
    if tolerance_ns >= FOR_EVER_NS:
        raise ValueError(f"tolerance: expected a finite duration of 0 or more, got {tolerance}")
    if tolerance_ns < 0:
        raise ValueError(f"tolerance: expected a finite duration of 0 or more, got {tolerance_ns / 1e9} s")
    return tolerance_ns


def _policies(policy: LookupPolicy | None) -> tuple[Any, Any]:
    """The policy for messages whose stamp is 0, and that for all others."""
    given: LookupPolicy = {} if policy is None else policy
    if not isinstance(given, Mapping):
        raise TypeError(f"policy: expected a LookupPolicy, which is a dict, got {kind_of(given)}")
    if "timeout" in given:
        raise TypeError("policy: a LookupPolicy has no timeout; pass buffer_timeout to the MessageFilter")
    at_times: LookupPolicy = {**given, "max_age": None}
    return policy_of("MessageFilter", True, **given), policy_of("MessageFilter", True, **at_times)
