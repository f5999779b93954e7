"""Owns the future of a transform: what completes it, in which thread, and what ends its wait."""

import time
import weakref
from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import TransformStamped

from tf2_py import BufferCore, InvalidArgumentException
from tf2_ros._forking import LOCK
from tf2_ros._rclpy import only_wakes_executor
from tf2_ros._receive.receiver_thread import hand_over
from tf2_ros._times import optional_timeout_ns
from tf2_ros._wait.contexts import Shutdown, unanswered
from tf2_ros._wait.deadlines import deadlines
from tf2_ros._wait.long_waits import LongWait, report_if_long
from tf2_ros._wait.lookup import Lookup
from tf2_ros._wait.waking_future import WakingFuture

__all__ = ["TransformFuture"]


class TransformFuture(WakingFuture[TransformStamped]):
    """
    The future of a transform that a buffer may not have yet.

    :param lookup: what to wait for. What is wrong with it is raised, except an invalid name: that ends the
        future at once.
    :param timeout: an rclpy Duration of steady time, after which the future holds a TimeoutException. None or
        an infinite one: never.

    The thread that inserts the missing data completes it. Callbacks are user code: where a receiver inserts
    the data, a future that has callbacks is completed by the executor of the listener's node. An asyncio loop
    that awaits it waits for that executor for GRACE_S at most.

    It lives as long as something refers to it, or a callback was added to it; then the wait ends.
    """

    # Those with callbacks: these alone keep a future alive.
    _kept_alive: "set[TransformFuture]" = set()

    # Two leading underscores keep these names clear of those of rclpy's Future, whatever its release.

    def __init__(self, core: BufferCore, lookup: Lookup, timeout: Any = None) -> None:
        self.__shutdown = Shutdown(core)
        super().__init__(self.__shutdown.happened)
        self.__begin_ns = time.monotonic_ns()
        self.__timeout_ns = optional_timeout_ns(timeout)
        # How many were added by anything but an executor. Under LOCK they decide which thread completes this.
        self.__callbacks = 0
        # Inside `__end_with`, under LOCK; callbacks that wake are called after it, if they are due.
        self.__ending = self.__is_due = False
        self.__claims = [None]  # the thread that takes it ends the wait
        self.__outcome: Callable[[], Any] | None = None  # known, and about to be set by an executor
        self.__wakers: list[Callable[[Any], None]] = []
        self.__core: BufferCore | None = core
        self.__wait: Any = None
        self.__report: LongWait | None = None
        try:
            wait = self.__wait = lookup.wait(core, _notify(weakref.ref(self)))
        except InvalidArgumentException as error:
            self.__fail(error)
            return
        # From here on, another thread may complete this at any time.
        answer = wait.answer
        if answer is not None:
            self.succeed(answer)
        if self.over():
            self.__wait = self.__core = None
            return
        if self.__timeout_ns is not None:
            deadlines.add(self.__begin_ns + self.__timeout_ns, self)
        self.__report = report_if_long([wait])

    def answered(self, answer: Any) -> Callable[[], None] | None:
        """Complete this, or return what completes it, because that runs callbacks."""
        return self.__end_with(lambda: answer, partial(self.succeed, answer))

    def succeed(self, answer: Any) -> None:
        """The answer is available."""
        if self.__claim():
            super().set_result(answer)

    def expire(self) -> None:
        """The timeout is over: the answer if it has just arrived, or a TimeoutException."""
        self.__end_unanswered()

    def end_with_context(self) -> None:
        """The same, because the context was shut down."""
        self.__end_unanswered()

    def over(self) -> bool:
        """Whether the wait has ended, in whatever way."""
        return not self.__claims

    def cancel(self) -> None:
        """End the wait; without effect if there is an answer, or a thread is about to set it."""
        if self.__claim():
            super().cancel()

    def set_result(self, result: Any) -> None:
        """End the wait with this result."""
        self.__claim()
        super().set_result(result)

    def set_exception(self, exception: BaseException) -> None:
        """End the wait with this exception."""
        self.__claim()
        super().set_exception(exception)

    def add_done_callback(self, callback: Callable[[Any], object]) -> None:
        """Add a callback; from now on it keeps the future alive."""
        if not only_wakes_executor(callback):
            with LOCK:
                if not self.over():
                    self.__callbacks += 1
                    TransformFuture._kept_alive.add(self)
                    super().add_done_callback(callback)
                    if self.over():  # a finalizer ended it meanwhile
                        TransformFuture._kept_alive.discard(self)
                    return
        super().add_done_callback(callback)

    def remove_done_callback(self, callback: Callable[[Any], None]) -> bool:
        """Remove a callback; whether it had been added."""
        with LOCK:
            removed: bool = super().remove_done_callback(callback)
            if removed and not only_wakes_executor(callback):
                self.__callbacks -= 1
                if self.__callbacks == 0:
                    TransformFuture._kept_alive.discard(self)
        return removed

    def _wake_when_known(self, waker: Callable[[Any], None]) -> None:
        with LOCK:
            if self.__outcome is None:
                self.__wakers.append(waker)
                return
        waker(self)

    def _known_outcome(self) -> TransformStamped:
        assert self.__outcome is not None
        return self.__outcome()

    def __end_unanswered(self) -> None:
        wait, core = self.__wait, self.__core
        if wait is None or core is None:
            return
        wait.cancel()
        answer = wait.answer
        if answer is not None:
            rest = self.answered(answer)
        else:
            error = unanswered(self.__shutdown, self.__begin_ns, self.__timeout_ns, wait.reason)
            rest = self.__end_with(partial(_raise, error), partial(self.__fail, error))
        if rest is not None:
            hand_over(core, rest)

    def __end_with(self, outcome: Callable[[], Any], end: Callable[[], None]) -> Callable[[], None] | None:
        # Ends this where that runs no user code; otherwise returns what ends it.
        with LOCK:
            if self.__callbacks == 0:
                self.__ending, self.__is_due = True, False
                end()
                self.__ending = False
                wakers = None
            else:
                if self.__outcome is None:
                    self.__outcome = outcome
                wakers, self.__wakers = self.__wakers, []
        if wakers is None:
            if self.__is_due:
                self._tf2_completed()
            return None
        for waker in wakers:
            waker(self)
        return end

    def _tf2_completed(self) -> None:
        with LOCK:
            if self.__ending:
                self.__is_due = True
                return
        super()._tf2_completed()

    def __fail(self, error: BaseException) -> None:
        if self.__claim():
            # Its traceback leads back to this future: only the collector would free both.
            super().set_exception(error.with_traceback(None))

    def __claim(self) -> bool:
        # Of all threads that try to end the wait, one gets True and does it.
        try:
            self.__claims.pop()
        except IndexError:
            return False
        wait, self.__wait, self.__core = self.__wait, None, None  # they hold the buffer
        self.__report = None
        if wait is not None:
            wait.cancel()
        TransformFuture._kept_alive.discard(self)
        return True


def _notify(reference: "weakref.ref[TransformFuture]") -> Callable[[Any], Callable[[], None] | None]:
    # The engine keeps this as long as the future waits; it must not keep the future alive.
    def notify(answer: Any) -> Callable[[], None] | None:
        future = reference()
        return None if future is None else future.answered(answer)

    return notify


def _raise(error: BaseException) -> None:
    raise error
