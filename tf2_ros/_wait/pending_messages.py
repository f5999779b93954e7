"""Owns the messages that wait for their transforms: when each passes, and why one is dropped."""

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from enum import Enum
from functools import partial
from typing import Any

from rclpy.time import Time

from tf2_py import TransformException
from tf2_py._internal import time_ns
from tf2_ros._forking import register_for_fork
from tf2_ros._wait.deadlines import deadlines
from tf2_ros._wait.long_waits import LongWait, report_if_long
from tf2_ros._wait.lookup import Lookup
from tf2_ros.buffer import Buffer

__all__ = ["FilterFailureReason", "PendingMessages"]


class FilterFailureReason(str, Enum):
    """
    Why a message filter dropped a message.

    ``OUT_THE_BACK``: it is older than all that the buffer keeps or still accepts. ``EMPTY_FRAME_ID``: its
    header names no frame. ``NO_TRANSFORM_FOUND``: the name of a frame is invalid, or the transform was not
    available and ``buffer_timeout`` is zero. ``QUEUE_FULL``: it was the oldest when one more had to wait than
    the queue holds. ``TIMEOUT``: its transform was not available in time.

    >>> from geometry_msgs.msg import PointStamped
    >>> from queue import Queue
    >>> from tf2_ros import Buffer, FilterFailureReason, MessageFilter
    >>> reasons = Queue()
    >>> with MessageFilter(None, Buffer(), "base_link", 100, node=node) as waiting:  # of a node that is spun
    ...     key = waiting.registerFailureCallback(lambda message, reason: reasons.put(reason))
    ...     waiting.add(PointStamped())
    ...     reasons.get(timeout=5) is FilterFailureReason.EMPTY_FRAME_ID
    True
    """

    OUT_THE_BACK = "OUT_THE_BACK"
    EMPTY_FRAME_ID = "EMPTY_FRAME_ID"
    NO_TRANSFORM_FOUND = "NO_TRANSFORM_FOUND"
    QUEUE_FULL = "QUEUE_FULL"
    TIMEOUT = "TIMEOUT"


class _PendingMessage:
    """One message that waits."""

    __slots__ = (
        "__weakref__",
        "answer",  # the transform into the first target frame
        "attempt",  # answers to earlier ones are ignored
        "frame",
        "lookups",
        "message",
        "missing",  # the wait of each lookup that has no answer, by its index in `lookups`
        "number",
        "owner",
        "report",
        "stamp",
        "stamp_ns",
    )

    def __init__(self, owner: "PendingMessages", number: int, message: Any) -> None:
        self.owner = owner
        self.number = number
        self.message = message
        # Without the slash that a buffer removes from the names of transforms, too.
        self.frame = message.header.frame_id.removeprefix("/")
        self.stamp = message.header.stamp
        self.stamp_ns = time_ns(self.stamp, "header.stamp")
        self.lookups: list[Lookup] = []
        self.missing: dict[int, Any] = {}
        self.attempt = 0
        self.answer: Any = None
        self.report: LongWait | None = None

    def over(self) -> bool:
        """Whether it has ceased to wait."""
        return not self.missing

    def expire(self) -> None:
        """Its timeout is over."""
        self.owner.expire(self)


class PendingMessages:
    """
    Keeps messages until the buffer can transform them into every target frame.

    :param passed: called with a message and its transform into the first target frame.
    :param dropped: called with a message, the reason, and the text of the lookup's error, if one was tried.

    One of them is called once for each message, in the thread that caused it, in the order of the causes;
    they must not raise. An insert costs nothing for messages that it does not complete.
    """

    def __init__(
        self,
        buffer: Buffer,
        passed: Callable[[Any, Any], None],
        dropped: Callable[[Any, FilterFailureReason, str], None],
    ) -> None:
        self._buffer = buffer
        self._passed = passed
        self._dropped = dropped
        self._lock = threading.RLock()
        self._pending: OrderedDict[int, _PendingMessage] = OrderedDict()  # the oldest first
        self._count = 0
        self._target_frames: tuple[str, ...] = ()
        self._tolerance_ns = 0
        self._queue_size = 0
        self._timeout_ns: int | None = None
        register_for_fork(self)

    def after_fork(self) -> None:
        """Make the lock anew: in a forked child it must be free."""
        self._lock = threading.RLock()

    def __len__(self) -> int:
        return len(self._pending)

    def configure(
        self, target_frames: Sequence[str], tolerance_ns: int, queue_size: int, timeout_ns: int | None
    ) -> None:
        """
        Set what messages wait for, including those that wait already.

        :param tolerance_ns: the transforms must be available for so much later, too.
        :param queue_size: how many may wait; 0: any number.
        :param timeout_ns: how long a message that is added from now on may wait, in steady time. 0: not at
            all; None: for ever.
        """
        with self._lock:
            again = (tuple(target_frames), tolerance_ns) != (self._target_frames, self._tolerance_ns)
            self._target_frames = tuple(target_frames)
            self._tolerance_ns = tolerance_ns
            self._queue_size = queue_size
            self._timeout_ns = timeout_ns
            if again:
                for pending in list(self._pending.values()):
                    self._look_up(pending)
            self._keep_to_size()

    def add(self, message: Any) -> None:
        """Keep a message, or let it pass at once, or drop it."""
        with self._lock:
            self._count += 1
            pending = _PendingMessage(self, self._count, message)
            self._pending[pending.number] = pending
            if not pending.frame:
                self._drop(pending, FilterFailureReason.EMPTY_FRAME_ID)
                return
            self._look_up(pending)
            if pending.missing and self._is_out_the_back(pending):
                self._drop(pending, FilterFailureReason.OUT_THE_BACK)
            elif pending.missing:
                pending.report = report_if_long(pending.missing.values())
                self._await(pending)
            # Those that were added before may have become too old while they waited.
            while self._pending and self._is_out_the_back(oldest := next(iter(self._pending.values()))):
                self._drop(oldest, FilterFailureReason.OUT_THE_BACK)

    def clear(self) -> int:
        """Remove all that wait; how many those were."""
        with self._lock:
            count = len(self._pending)
            for pending in list(self._pending.values()):
                self._remove(pending)
            return count

    def expire(self, pending: _PendingMessage) -> None:
        """The timeout of one is over."""
        with self._lock:
            if pending.number in self._pending:
                self._drop(pending, FilterFailureReason.TIMEOUT)

    def _await(self, pending: _PendingMessage) -> None:
        if self._timeout_ns is None:
            self._keep_to_size()
        elif self._timeout_ns <= 0:
            self._drop(pending, FilterFailureReason.NO_TRANSFORM_FOUND)
        else:
            deadlines.add(time.monotonic_ns() + self._timeout_ns, pending)
            self._keep_to_size()

    def _keep_to_size(self) -> None:
        while self._queue_size and len(self._pending) > self._queue_size:
            self._drop(next(iter(self._pending.values())), FilterFailureReason.QUEUE_FULL)

    def _look_up(self, pending: _PendingMessage) -> None:
        # Begin anew: the answers of an earlier attempt are out of date.
        self._stop(pending)
        attempt = pending.attempt
        try:
            pending.lookups = self._lookups(pending)
            for place, lookup in enumerate(pending.lookups):
                wait = lookup.wait(self._buffer, partial(self._receive_answer, pending, attempt, place))
                answer = wait.answer
                if answer is None:
                    pending.missing[place] = wait
                elif place == 0:
                    pending.answer = answer
        except (TransformException, OverflowError, ValueError) as error:
            self._drop(pending, FilterFailureReason.NO_TRANSFORM_FOUND, str(error))
            return
        if not pending.missing:
            self._pass(pending)

    def _lookups(self, pending: _PendingMessage) -> list[Lookup]:
        lookups = [Lookup.simple(target, pending.frame, pending.stamp) for target in self._target_frames]
        # The latest time has no later one.
        if self._tolerance_ns and pending.stamp_ns:
            later = Time(nanoseconds=pending.stamp_ns + self._tolerance_ns)
            lookups += [Lookup.simple(target, pending.frame, later) for target in self._target_frames]
        return lookups

    def _receive_answer(self, pending: _PendingMessage, attempt: int, place: int, answer: Any) -> None:
        with self._lock:
            if attempt != pending.attempt or pending.missing.pop(place, None) is None:
                return
            if place == 0:
                pending.answer = answer
            if pending.missing:
                return
            if len(pending.lookups) == 1:
                self._pass(pending)
            else:
                # The buffer may not have what was found first any more.
                self._look_up(pending)

    def _is_out_the_back(self, pending: _PendingMessage) -> bool:
        for place in pending.missing:
            lookup = pending.lookups[place]
            stamp = lookup.source_time
            stamp_ns = stamp.nanoseconds if isinstance(stamp, Time) else pending.stamp_ns
            try:
                newest_ns = self._buffer.get_latest_common_time(
                    lookup.target_frame, lookup.source_frame
                ).nanoseconds
            except TransformException:
                continue  # not connected yet
            # Every frame on the path now refuses data of this time.
            if stamp_ns and newest_ns - self._buffer.cache_time_ns > stamp_ns:
                return True
        return False

    def _pass(self, pending: _PendingMessage) -> None:
        self._remove(pending)
        self._passed(pending.message, pending.answer)

    def _drop(self, pending: _PendingMessage, reason: FilterFailureReason, text: str = "") -> None:
        if not text and pending.missing:
            text = str(next(iter(pending.missing.values())).reason())
        self._remove(pending)
        self._dropped(pending.message, reason, text)

    def _remove(self, pending: _PendingMessage) -> None:
        del self._pending[pending.number]
        self._stop(pending)

    def _stop(self, pending: _PendingMessage) -> None:
        for wait in pending.missing.values():
            wait.cancel()
        pending.missing.clear()
        pending.attempt += 1
