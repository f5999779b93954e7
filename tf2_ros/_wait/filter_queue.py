"""Decide when a message filter passes or drops each message, and iterate over messages asynchronously."""

import itertools
import os
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from functools import partial
from typing import Any, Generic, NamedTuple, TypeVar

from tf2_py import BufferCore, TransformException
from tf2_py._internal import frame_name, time_ns
from tf2_ros._forking import refuse_inherited
from tf2_ros._wait.blocking import LongWait, Lookup, report_if_long
from tf2_ros._wait.futures import WakingFuture
from tf2_ros._wait.rounds import first_value, move_outcome
from tf2_ros._wait.timers import deadlines
from tf2_ros.buffer import Buffer

_Item = TypeVar("_Item")


class FilterFailureReason(str, Enum):
    """
    Why a message filter dropped a message.

    ``OUT_THE_BACK``: it is older than everything that the buffer keeps or accepts. ``EMPTY_FRAME_ID``: its
    header names no frame. ``NO_TRANSFORM_FOUND``: the name of a frame is invalid, or the transform was not
    available and ``buffer_timeout`` is zero. ``QUEUE_FULL``: it was the oldest when the queue overflowed.
    ``TIMEOUT``: its transform was not available in time.

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


class Outcome(NamedTuple):
    """What became of a message."""

    message: Any
    transform: Any  # into the first target frame, if it passed
    reason: FilterFailureReason | None  # if it was dropped
    text: str  # of the lookup's error, if it was dropped and one was tried


class Needed(NamedTuple):
    """What a message waits for: into which frames it can be transformed, also this much later."""

    target_frames: tuple[str, ...]
    tolerance_ns: int


class _Search:
    """The lookups for one message; not changed any more once the message has it."""

    __slots__ = ("__weakref__", "answer", "lookups", "missing", "needed")

    def __init__(self, needed: Needed, lookups: list[Lookup]) -> None:
        self.needed = needed
        self.lookups = lookups
        self.answer: Any = None  # the transform into the first target frame, if it was available at once
        self.missing: dict[int, Any] = {}  # the wait of each other lookup, by its index in `lookups`

    def is_answered(self) -> bool:
        """Whether every answer is available, also if this was not notified yet."""
        return all(wait.answer is not None for wait in self.missing.values())

    def transform(self) -> Any:
        """The transform into the first target frame, of one that is answered."""
        return self.missing[0].answer if 0 in self.missing else self.answer

    def cancel(self) -> None:
        """End the waits."""
        for wait in self.missing.values():
            wait.cancel()


class _PendingMessage:
    """One message that waits."""

    __slots__ = (
        "__weakref__",
        "frame",
        "message",
        "number",  # in order of arrival; 0: not added yet
        "owner",
        "report",
        "search",
        "stamp_ns",
    )

    def __init__(self, owner: "PendingMessages", message: Any) -> None:
        self.owner = owner
        self.number = 0
        self.message = message
        header = message.header
        # Without a leading slash, which a buffer also removes from the names of transforms.
        self.frame = frame_name(header.frame_id, "header.frame_id").removeprefix("/")
        self.stamp_ns = time_ns(header.stamp, "header.stamp")
        self.search: _Search | None = None
        self.report: LongWait | None = None

    def over(self) -> bool:
        """Whether it no longer waits; not while it is looked up again, or its deadline would be forgotten."""
        return self.number not in self.owner.pending

    def expire(self) -> None:
        """Drop the message, because its timeout has passed."""
        self.owner.expire(self)


class PendingMessages:
    """
    Keeps messages until the buffer can transform them into every target frame.

    :param needed: see :meth:`require`.
    :param queue_size: see :meth:`limit`.
    :param timeout_ns: how long a message may wait, in steady time. 0: not at all; None: forever.
    :param announce: called before a message gets its outcome, which :meth:`next_outcome` then returns, in the
        thread that caused it, with the lock held. It must not run user code. It returns whether anyone will
        ask for the outcome.

    Nothing under the lock runs user code: the buffer's own methods are called, not those of a subclass, and
    messages are read before. An insert costs nothing for messages that it does not complete. In the main
    thread, a signal handler may interrupt any method, add messages or insert transforms there, and raise:
    each message still gets one outcome.
    """

    def __init__(
        self,
        buffer: Buffer,
        needed: Needed,
        queue_size: int,
        timeout_ns: int | None,
        announce: Callable[[], bool],
    ) -> None:
        self._buffer = buffer
        self.needed = needed
        self._queue_size = queue_size
        self._timeout_ns = timeout_ns
        self._announce = announce
        self._lock = threading.RLock()
        self.pending: OrderedDict[int, _PendingMessage] = OrderedDict()  # the oldest first
        self._outcomes: deque[Outcome] = deque()
        self.count = 0  # of all that were added
        # By the reason if they were dropped.
        self.ended: dict[FilterFailureReason | None, int] = dict.fromkeys((None, *FilterFailureReason), 0)
        self._numbers = itertools.count(1)

    def next_outcome(self) -> "Outcome | None":
        """Get and remove the oldest outcome."""
        with self._lock:  # one that was announced is there
            return self._outcomes.popleft() if self._outcomes else None

    def require(self, **changed: Any) -> None:
        """
        Change fields of what is ``needed``, also for messages that wait already.

        From now on no message passes because of what was needed before.
        """
        with self._lock:
            self.needed = self.needed._replace(**changed)
            for pending in list(self.pending.values()):
                if pending.number in self.pending:
                    self._look_up(pending)

    def limit(self, queue_size: int) -> None:
        """Set how many messages may wait; 0: any number. The oldest above that are dropped."""
        with self._lock:
            self._queue_size = queue_size
            self._keep_to_size()

    def add(self, message: Any) -> None:
        """
        Keep a message, or let it pass at once, or drop it.

        :raises AttributeError: its header lacks something.
        :raises TypeError: the name or the stamp in its header is of another type.
        """
        pending = _PendingMessage(self, message)
        with self._lock:
            pending.number = next(self._numbers)
            # No signal handler comes between these.
            self.count += 1
            self.pending[pending.number] = pending
            try:
                self._begin(pending)
            except BaseException:
                # A signal handler has raised: nothing would complete it.
                if self.pending.pop(pending.number, None) is not None:
                    self._stop(pending)
                    self.count -= 1
                raise

    def clear(self) -> int:
        """Remove all messages that wait, and all outcomes; return how many that leaves without one."""
        count = 0
        with self._lock:
            for pending in list(self.pending.values()):
                count += self.pending.pop(pending.number, None) is not None
                self._stop(pending)
            while self._outcomes:
                count += self._outcomes.popleft().reason is None
        return count

    def expire(self, pending: _PendingMessage) -> None:
        """Drop a message, because its timeout has passed."""
        with self._lock:
            self._drop(pending, FilterFailureReason.TIMEOUT)

    def _begin(self, pending: _PendingMessage) -> None:
        if not pending.frame:
            self._drop(pending, FilterFailureReason.EMPTY_FRAME_ID)
            return
        self._look_up(pending)
        if pending.number in self.pending and self._is_out_the_back(pending):
            self._drop(pending, FilterFailureReason.OUT_THE_BACK)
        elif pending.number in self.pending:
            self._await(pending)
        # Those that were added before may have become too old while they waited.
        while (oldest := first_value(self.pending)) is not None and self._is_out_the_back(oldest):
            self._drop(oldest, FilterFailureReason.OUT_THE_BACK)

    def _await(self, pending: _PendingMessage) -> None:
        if self._timeout_ns is None:
            self._keep_to_size()
        elif self._timeout_ns <= 0:
            self._drop(pending, FilterFailureReason.NO_TRANSFORM_FOUND)
        else:
            deadlines.add(time.monotonic_ns() + self._timeout_ns, pending)
            self._keep_to_size()

    def _keep_to_size(self) -> None:
        while self._queue_size and len(self.pending) > self._queue_size:
            oldest = first_value(self.pending)
            if oldest is not None:
                self._drop(oldest, FilterFailureReason.QUEUE_FULL)

    def _look_up(self, pending: _PendingMessage) -> None:
        # The message keeps its search until the next one is complete, so that an answer to one of the two is
        # noticed whenever a signal handler interrupts this.
        try:
            search = _Search(self.needed, self._lookups(pending))
            for place, lookup in enumerate(search.lookups):
                wait = lookup.wait(self._buffer, partial(self._receive_answer, pending))
                answer = wait.answer
                if answer is None:
                    search.missing[place] = wait
                elif place == 0:
                    search.answer = answer
        except (TransformException, OverflowError, ValueError) as error:
            self._drop(pending, FilterFailureReason.NO_TRANSFORM_FOUND, str(error))
            return
        before, pending.search = pending.search, search
        if before is not None:
            before.cancel()
        pending.report = report_if_long(search.missing.values())
        self._settle(pending)

    def _lookups(self, pending: _PendingMessage) -> list[Lookup]:
        stamps_ns = [pending.stamp_ns]
        # The latest time has no later one.
        if self.needed.tolerance_ns and pending.stamp_ns:
            stamps_ns.append(pending.stamp_ns + self.needed.tolerance_ns)
        targets = self.needed.target_frames
        return [Lookup.simple(target, pending.frame, ns) for ns in stamps_ns for target in targets]

    def _receive_answer(self, pending: _PendingMessage, _: Any) -> None:
        with self._lock:
            if pending.number in self.pending:
                self._settle(pending)

    def _settle(self, pending: _PendingMessage) -> None:
        """Let a message pass if every answer is available."""
        search = pending.search
        if search is None or not search.is_answered():
            return
        if search.needed is self.needed and (len(search.lookups) == 1 or not search.missing):
            self._pass(pending, search)
        else:
            # The buffer may have lost what was found first, or something else is needed by now.
            self._look_up(pending)

    def _is_out_the_back(self, pending: _PendingMessage) -> bool:
        search = pending.search
        if search is None:
            return False
        for place in search.missing:
            lookup = search.lookups[place]
            stamp_ns = lookup.source_time
            try:
                newest_ns = BufferCore.get_latest_common_time(
                    self._buffer, lookup.target_frame, lookup.source_frame
                ).nanoseconds
            except TransformException:
                continue  # not connected yet
            # Every frame on the path now refuses data of this time.
            if stamp_ns and newest_ns - self._buffer._tf2_cache_time_ns > stamp_ns:
                return True
        return False

    def _pass(self, pending: _PendingMessage, search: _Search) -> None:
        # One insert may also have answered older ones, in a thread that has not notified them yet.
        while (oldest := first_value(self.pending)) is not None and oldest is not pending:
            if oldest.search is None or not oldest.search.is_answered():
                break
            self._settle(oldest)
        self._end(pending, Outcome(pending.message, search.transform(), None, ""))

    def _drop(self, pending: _PendingMessage, reason: FilterFailureReason, text: str = "") -> None:
        if not text and pending.search is not None:
            text = next((str(wait.reason()) for wait in pending.search.missing.values()), "")
        self._end(pending, Outcome(pending.message, None, reason, text))

    def _end(self, pending: _PendingMessage, outcome: "Outcome") -> None:
        if pending.number in self.pending:
            outcomes = self._outcomes if self._announce() else deque()
            move_outcome(self.pending, pending.number, outcomes, outcome, self.ended, outcome.reason)
        self._stop(pending)

    def _stop(self, pending: _PendingMessage) -> None:
        if pending.search is not None:
            pending.search.cancel()


class MessageStream(Generic[_Item]):
    """
    An asynchronous iterator over items that another thread puts in; ends, when closed, after the last.

    :param has_ended: returns whether a shutdown prevents new items; this also ends the iteration.
    :param kept: the owner's references to what awaits an item.

    If several iterate, each item is given to one of them.
    """

    def __init__(self, has_ended: Callable[[], bool], kept: set[Any] | None = None) -> None:
        self._process = os.getpid()
        self._has_ended = has_ended
        self._kept = kept
        self._items: deque[_Item] = deque()
        # Never replaced, so that one that is about to be added is found.
        self._awaiting: deque[WakingFuture[None]] = deque()
        self._closed = False

    def put(self, item: _Item) -> None:
        """Let the iteration continue with this item."""
        self._items.append(item)
        self._wake()

    def close(self) -> None:
        """End the iteration after what was put in."""
        self._closed = True
        self._wake()

    def __aiter__(self) -> "MessageStream[_Item]":
        return self

    async def __anext__(self) -> _Item:
        refuse_inherited(self, self._process)
        while True:
            arrival = _Arrival(self._has_ended, self._kept)
            # First this, then the check; `put` does this in the opposite order.
            self._awaiting.append(arrival)
            try:
                return self._items.popleft()
            except IndexError:
                if self._closed or self._has_ended():
                    raise StopAsyncIteration from None
                await arrival
            finally:
                with suppress(ValueError):  # it was woken
                    self._awaiting.remove(arrival)

    def _wake(self) -> None:
        # Wake all of them, because a single one may be about to leave. Later ones check by themselves.
        for _ in range(len(self._awaiting)):
            with suppress(IndexError):  # one has left
                self._awaiting.popleft().set_result(None)


class _Arrival(WakingFuture[None]):
    """Completed when the iteration is to look again."""

    def expire(self) -> None:
        """Wake the iteration, because nothing arrives any more."""
        self.set_result(None)
