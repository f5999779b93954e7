"""Owns the messages that wait for their transforms: when each comes out, and why one is dropped."""

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from enum import Enum
from functools import partial
from typing import Any

from rclpy.time import Time

from tf2_py import BufferCore, TransformException
from tf2_ros._forking import tell_of_fork
from tf2_ros._wait.deadlines import deadlines
from tf2_ros._wait.waiting import Lookup
from tf2_ros.buffer import Buffer

__all__ = ["FilterFailureReason", "HeldMessages"]


class FilterFailureReason(str, Enum):
    """
    Why a message did not come through a filter.

    ``OUT_THE_BACK``: it is older than all that the buffer keeps or still takes. ``EMPTY_FRAME_ID``: it does
    not say in which frame it is. ``NO_TRANSFORM_FOUND``: a frame has a name that no lookup accepts, or the
    transform was not there and was not to be waited for. ``QUEUE_FULL``: it was the oldest when one more had
    to wait than the queue holds. ``TIMEOUT``: its transform did not come in time.
    """

    OUT_THE_BACK = "OUT_THE_BACK"
    EMPTY_FRAME_ID = "EMPTY_FRAME_ID"
    NO_TRANSFORM_FOUND = "NO_TRANSFORM_FOUND"
    QUEUE_FULL = "QUEUE_FULL"
    TIMEOUT = "TIMEOUT"


class _Held:
    """One message that waits."""

    __slots__ = (
        "__weakref__",
        "answer",  # the transform into the first target frame
        "attempt",  # answers to earlier ones come too late
        "frame",
        "lookups",
        "message",
        "missing",  # the wait of each lookup that has no answer, by its place in `lookups`
        "number",
        "owner",
        "stamp",
        "stamp_ns",
    )

    def __init__(self, owner: "HeldMessages", number: int, message: Any) -> None:
        self.owner = owner
        self.number = number
        self.message = message
        # As transforms lose theirs on the way into a buffer.
        self.frame = message.header.frame_id.removeprefix("/")
        self.stamp = message.header.stamp
        self.stamp_ns = self.stamp.sec * 1_000_000_000 + self.stamp.nanosec
        self.lookups: list[Lookup] = []
        self.missing: dict[int, Any] = {}
        self.attempt = 0
        self.answer: Any = None

    def over(self) -> bool:
        """Whether it waits no more."""
        return not self.missing

    def expire(self) -> None:
        """Its time is over."""
        self.owner.expire(self)


class HeldMessages:
    """
    Holds messages until the buffer can carry them into every target frame.

    :param passed: called with a message and its transform into the first target frame.
    :param dropped: called with a message, the reason, and what the lookup said, if one was tried.

    Both are called in whichever thread brought it about, in the order in which it came about, once for each
    message; they must not raise. Nothing is done per message when a transform comes, but for the messages
    that it completes.
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
        self._held: OrderedDict[int, _Held] = OrderedDict()  # the oldest first
        self._count = 0
        self._target_frames: tuple[str, ...] = ()
        self._tolerance_ns = 0
        self._queue_size = 0
        self._timeout_ns: int | None = None
        tell_of_fork(self)

    def after_fork(self) -> None:
        """Let nobody hold the lock in a forked child."""
        self._lock = threading.RLock()

    def __len__(self) -> int:
        return len(self._held)

    def configure(
        self, target_frames: Sequence[str], tolerance_ns: int, queue_size: int, timeout_ns: int | None
    ) -> None:
        """
        Set what messages wait for; those that wait already wait for it anew.

        :param tolerance_ns: the transforms must be there for so much later, too.
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
                for held in list(self._held.values()):
                    self._look_up(held)
            self._keep_to_size()

    def add(self, message: Any) -> None:
        """Hold a message, or let it pass at once, or drop it."""
        with self._lock:
            self._count += 1
            held = _Held(self, self._count, message)
            self._held[held.number] = held
            if not held.frame:
                self._drop(held, FilterFailureReason.EMPTY_FRAME_ID)
                return
            self._look_up(held)
            if held.missing and self._is_out_the_back(held):
                self._drop(held, FilterFailureReason.OUT_THE_BACK)
            elif held.missing:
                self._await(held)
            # Those that came before may have become too old while they waited.
            while self._held and self._is_out_the_back(oldest := next(iter(self._held.values()))):
                self._drop(oldest, FilterFailureReason.OUT_THE_BACK)

    def clear(self) -> int:
        """Forget all that wait; how many those were."""
        with self._lock:
            count = len(self._held)
            for held in list(self._held.values()):
                self._let_go(held)
            return count

    def expire(self, held: _Held) -> None:
        """The time of one is over."""
        with self._lock:
            if held.number in self._held:
                self._drop(held, FilterFailureReason.TIMEOUT)

    def _await(self, held: _Held) -> None:
        if self._timeout_ns is None:
            self._keep_to_size()
        elif self._timeout_ns <= 0:
            self._drop(held, FilterFailureReason.NO_TRANSFORM_FOUND)
        else:
            deadlines.add(time.monotonic_ns() + self._timeout_ns, held)
            self._keep_to_size()

    def _keep_to_size(self) -> None:
        while self._queue_size and len(self._held) > self._queue_size:
            self._drop(next(iter(self._held.values())), FilterFailureReason.QUEUE_FULL)

    def _look_up(self, held: _Held) -> None:
        # Begin anew: whatever an earlier attempt brings is out of date.
        self._stop(held)
        attempt = held.attempt
        try:
            held.lookups = self._lookups(held)
            for place, lookup in enumerate(held.lookups):
                wait = BufferCore._wait(
                    self._buffer, *lookup, notify=partial(self._take, held, attempt, place)
                )
                answer = wait.answer
                if answer is None:
                    held.missing[place] = wait
                elif place == 0:
                    held.answer = answer
        except (TransformException, OverflowError, ValueError) as error:
            self._drop(held, FilterFailureReason.NO_TRANSFORM_FOUND, str(error))
            return
        if not held.missing:
            self._pass(held)

    def _lookups(self, held: _Held) -> list[Lookup]:
        lookups: list[Lookup] = [
            (target, held.frame, held.stamp, None, None) for target in self._target_frames
        ]
        # The latest time has no later one.
        if self._tolerance_ns and held.stamp_ns:
            later = Time(nanoseconds=held.stamp_ns + self._tolerance_ns)
            lookups += [(target, held.frame, later, None, None) for target in self._target_frames]
        return lookups

    def _take(self, held: _Held, attempt: int, place: int, answer: Any) -> None:
        with self._lock:
            if attempt != held.attempt or held.missing.pop(place, None) is None:
                return
            if place == 0:
                held.answer = answer
            if held.missing:
                return
            if len(held.lookups) == 1:
                self._pass(held)
            else:
                # What was found first may be forgotten by now.
                self._look_up(held)

    def _is_out_the_back(self, held: _Held) -> bool:
        for place in held.missing:
            target, source, stamp, _, _ = held.lookups[place]
            stamp_ns = stamp.nanoseconds if isinstance(stamp, Time) else held.stamp_ns
            try:
                newest_ns = self._buffer.get_latest_common_time(target, source).nanoseconds
            except TransformException:
                continue  # not connected yet
            # Every frame on the way now refuses what would be needed.
            if stamp_ns and newest_ns - self._buffer._cache_time_ns > stamp_ns:
                return True
        return False

    def _pass(self, held: _Held) -> None:
        self._let_go(held)
        self._passed(held.message, held.answer)

    def _drop(self, held: _Held, reason: FilterFailureReason, text: str = "") -> None:
        if not text and held.missing:
            text = str(next(iter(held.missing.values())).reason())
        self._let_go(held)
        self._dropped(held.message, reason, text)

    def _let_go(self, held: _Held) -> None:
        del self._held[held.number]
        self._stop(held)

    def _stop(self, held: _Held) -> None:
        for wait in held.missing.values():
            wait.cancel()
        held.missing.clear()
        held.attempt += 1
