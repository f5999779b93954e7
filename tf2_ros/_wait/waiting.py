"""Owns waiting for transforms on top of the engine: blocked threads, futures, and what ends each wait."""

import asyncio
import sys
import time
import warnings
import weakref
from collections.abc import Callable, Generator
from contextlib import suppress
from functools import partial
from types import FrameType, FunctionType
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.task import Future, Task

from tf2_py import BufferCore, InvalidArgumentException, TimeoutException
from tf2_ros._forking import LOCK
from tf2_ros._receive.thread import hand_over
from tf2_ros._wait.deadlines import deadlines as _deadlines

__all__ = [
    "FOR_EVER_NS",
    "Lookup",
    "TransformFuture",
    "WakingFuture",
    "aliveness",
    "block",
    "duration_ns",
    "timeout_ns",
]

# The functions of this module that are added to a future only wake an executor.
EXECUTOR_MODULE = "rclpy.executors"

GRACE_S = 1.0  # for an executor to complete a future whose outcome is known
STEP_CHECK_NS = 2_000_000  # how often to look whether an executor has left the step of a task
FOR_EVER_NS = 2**62  # 146 years; added to a steady time, it still fits into 64 bits

# As BufferCore._wait takes it: target and source frame, time, then fixed frame and target time or None twice.
Lookup = tuple[str, str, Any, str | None, Any]


def duration_ns(duration: Any) -> int:
    """
    The nanoseconds of an rclpy ``Duration``, or of a duration message; TypeError for anything else.

    What is longer than FOR_EVER_NS becomes that, to either side.
    """
    if hasattr(duration, "nanoseconds"):
        nanoseconds = duration.nanoseconds
    elif hasattr(duration, "sec") and hasattr(duration, "nanosec"):
        nanoseconds = duration.sec * 1_000_000_000 + duration.nanosec
    else:
        raise TypeError(f"a timeout is an rclpy.duration.Duration, not {type(duration).__name__}")
    # Before it becomes an int: it may be an infinite float.
    return int(max(-FOR_EVER_NS, min(nanoseconds, FOR_EVER_NS)))


def timeout_ns(timeout: Any) -> int | None:
    """The same of a timeout; None, for no end, where that is None or FOR_EVER_NS."""
    nanoseconds = FOR_EVER_NS if timeout is None else duration_ns(timeout)
    return None if nanoseconds == FOR_EVER_NS else nanoseconds


def aliveness(context: Any) -> Callable[[], bool]:
    """
    What tells whether a context that is alive still is; where it is not, or never was, always true.

    A buffer can be used where ROS was never started; then there is nothing whose end to watch for.
    """
    # Not context.ok(): its lock may be held for ever by a thread that a fork left behind in the parent.
    handle = context.handle
    return handle.ok if handle is not None and handle.ok() else _always


def _always() -> bool:
    return True


def block(core: BufferCore, lookup: Lookup, timeout_ns: int, context: Any) -> Any:
    """
    Wait, without the GIL, until there is an answer, and return it.

    :param timeout_ns: nanoseconds of steady time, at most FOR_EVER_NS; after that, what the lookup raises is
        raised.
    :param context: the rclpy context whose end ends the wait, unless it was not alive to begin with.

    A name that can never be looked up is raised at once.
    """
    alive = aliveness(context)
    while True:
        wait = BufferCore._wait(core, *lookup)
        answer = wait.answer
        if answer is not None:
            return answer
        if wait.wait_for(timeout_ns, alive):
            return wait.answer
        reason = wait.reason()
        if reason is not None:
            raise reason
        # It has just come: the next look finds it.


class WakingFuture(Future):
    """A future that may be completed in any thread: it wakes whatever runs the tasks that await it."""

    _callbacks: list[Callable[[Any], None]]  # rclpy's

    def __init__(self) -> None:
        super().__init__()
        self._lock = LOCK  # instead of rclpy's own, which a fork may find held

    def _schedule_or_invoke_done_callbacks(self) -> None:
        # rclpy's leaves out those behind one that raises more than an Exception.
        with self._lock:
            executor = self._executor()
            callbacks, self._callbacks = self._callbacks, []
        error: BaseException | None = None
        for callback in callbacks:
            try:
                if executor is None:
                    callback(self)
                else:
                    executor.create_task(callback, self)
            except Exception as raised:
                warnings.warn(f"Unhandled exception in done callback: {raised}", stacklevel=2)
            except BaseException as raised:
                if error is None:
                    error = raised
        try:
            if error is not None:
                raise error
        finally:
            del error  # its traceback leads here

    def __await__(self) -> Generator[Any, Any, Any]:
        # Callbacks that only wake are none that a future is kept for: they go past those of a subclass.
        sleeper = _SleepingTask.current()
        if sleeper is not None:
            # rclpy looks at a task that awaits only when its executor has something else to do, and whoever
            # completes this future gives it nothing.
            Future.add_done_callback(self, _task_waker(sleeper))
            try:
                return (yield from super().__await__())
            finally:
                sleeper.awake = True
        if (loop := _running_loop()) is not None:
            # asyncio would ask again and again instead.
            woken = loop.create_future()
            Future.add_done_callback(self, _loop_waker(loop, woken, 0.0))
            self._wake_when_known(_loop_waker(loop, woken, GRACE_S))
            yield from woken
            if not self.done() and not self.cancelled():
                return self._known_outcome()
        return (yield from super().__await__())

    def _wake_when_known(self, waker: Callable[[Any], None]) -> None:
        """Call this, in whatever thread, when the outcome is known before the future is done."""

    def _known_outcome(self) -> Any:
        """The outcome of a future that is not done, but has woken who waits for the outcome."""
        raise NotImplementedError


class TransformFuture(WakingFuture):
    """
    The future of a transform that a buffer may not have yet.

    :param lookup: what to wait for; what is wrong with it is raised, but for a name that can never be looked
        up: that ends the future at once.
    :param timeout: an rclpy Duration of steady time, after which the future holds a TimeoutException. None or
        an infinite one: never.

    The thread that inserts the missing data completes it. Callbacks are a user's code: where a receiver
    inserts the data, a future that has callbacks is completed by the executor of the listener's node. An
    asyncio loop that awaits it waits for that executor for GRACE_S at most.

    It lives as long as somebody holds it or has added a callback to it; when nobody does, the wait ends.
    """

    # Those that live by their callbacks alone.
    _held: "set[TransformFuture]" = set()

    # Two leading underscores keep these names clear of those of rclpy's Future, whatever its release.

    def __init__(self, core: BufferCore, lookup: Lookup, timeout: Any = None) -> None:
        super().__init__()
        self.__timeout_ns = timeout_ns(timeout)
        # That somebody else than an executor added. By them LOCK's holder decides who completes this.
        self.__callbacks = 0
        # In the middle of `__end_with`, under LOCK; callbacks that wake are called after it, if they are due.
        self.__ending = self.__is_due = False
        self.__claims = [None]  # who takes it ends the wait
        self.__outcome: Callable[[], Any] | None = None  # known, and about to be set by an executor
        self.__wakers: list[Callable[[Any], None]] = []
        self.__core: BufferCore | None = core
        self.__wait: Any = None
        try:
            self.__wait = BufferCore._wait(core, *lookup, notify=_notify(weakref.ref(self)))
        except InvalidArgumentException as error:
            self.__fail(error)
            return
        answer = self.__wait.answer
        if answer is not None:
            self.succeed(answer)
        elif self.__timeout_ns is not None:
            _deadlines.add(time.monotonic_ns() + self.__timeout_ns, self)

    def answered(self, answer: Any) -> Callable[[], None] | None:
        """Complete this, or return what completes it, because that runs callbacks."""
        return self.__end_with(lambda: answer, partial(self.succeed, answer))

    def succeed(self, answer: Any) -> None:
        """The answer is available."""
        if self.__claim():
            super().set_result(answer)

    def expire(self) -> None:
        """The timeout is over: the answer if it has just arrived, or a TimeoutException."""
        wait, core = self.__wait, self.__core
        if wait is None or core is None:
            return
        wait.cancel()
        answer = wait.answer
        if answer is not None:
            rest = self.answered(answer)
        else:
            assert self.__timeout_ns is not None
            error = TimeoutException(f"Waited {self.__timeout_ns / 1e9} s for the transform: {wait.reason()}")
            rest = self.__end_with(partial(_raise, error), partial(self.__fail, error))
        if rest is not None:
            hand_over(core, rest)

    def over(self) -> bool:
        """Whether the wait has ended, in whatever way."""
        return not self.__claims

    def cancel(self) -> None:
        """End the wait; nothing happens if an answer is there, or is just coming."""
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

    def add_done_callback(self, callback: Callable[[Any], None]) -> None:
        """Add a callback; from now on the future need not be held by anybody else."""
        if not _only_wakes(callback):
            with LOCK:
                if not self.over():
                    self.__callbacks += 1
                    TransformFuture._held.add(self)
                    super().add_done_callback(callback)
                    if self.over():  # a finalizer ended it meanwhile
                        TransformFuture._held.discard(self)
                    return
        super().add_done_callback(callback)

    def remove_done_callback(self, callback: Callable[[Any], None]) -> bool:
        """Remove a callback; whether it was there."""
        with LOCK:
            removed: bool = super().remove_done_callback(callback)
            if removed and not _only_wakes(callback):
                self.__callbacks -= 1
                if self.__callbacks == 0:
                    TransformFuture._held.discard(self)
        return removed

    def _wake_when_known(self, waker: Callable[[Any], None]) -> None:
        with LOCK:
            if self.__outcome is None:
                self.__wakers.append(waker)
                return
        waker(self)

    def _known_outcome(self) -> Any:
        assert self.__outcome is not None
        return self.__outcome()

    def __end_with(self, outcome: Callable[[], Any], end: Callable[[], None]) -> Callable[[], None] | None:
        # Ends this where that runs no user's code; else returns what ends it.
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
                self._schedule_or_invoke_done_callbacks()
            return None
        for waker in wakers:
            waker(self)
        return end

    def _schedule_or_invoke_done_callbacks(self) -> None:
        with LOCK:
            if self.__ending:
                self.__is_due = True
                return
        super()._schedule_or_invoke_done_callbacks()

    def __fail(self, error: BaseException) -> None:
        if self.__claim():
            # Its traceback would lead back to this future, and both would wait for the collector.
            super().set_exception(error.with_traceback(None))

    def __claim(self) -> bool:
        # Of those that want to end the wait, in any thread, the one that gets True does it.
        try:
            self.__claims.pop()
        except IndexError:
            return False
        wait, self.__wait, self.__core = self.__wait, None, None  # they hold the buffer
        if wait is not None:
            wait.cancel()
        TransformFuture._held.discard(self)
        return True


def _notify(reference: "weakref.ref[TransformFuture]") -> Callable[[Any], Callable[[], None] | None]:
    # The engine holds this for as long as the future waits, and must not keep the future from going.
    def notify(answer: Any) -> Callable[[], None] | None:
        future = reference()
        return None if future is None else future.answered(answer)

    return notify


def _raise(error: BaseException) -> None:
    raise error


class _SleepingTask:
    """A task of an executor that awaits. It is not held: it leads to whoever holds this."""

    def __init__(self, task: Task) -> None:
        self.awake = False
        self._task = weakref.ref(task)

    @classmethod
    def current(cls) -> "_SleepingTask | None":
        """The one that executes the caller."""
        # Nobody tells the awaited which task awaits it; the task is further up on the stack.
        frame: FrameType | None = sys._getframe(1)
        while frame is not None and frame.f_code is not Task.__call__.__code__:
            frame = frame.f_back
        return None if frame is None else cls(frame.f_locals["self"])

    def wake(self) -> None:
        """Have the executor look at the task, when it does not execute it any more."""
        task = self._task()
        executor = None if task is None else task._executor()
        if task is None or executor is None:
            return
        # An executor skips a task whose step another of its threads executes: it may have decided to sleep,
        # and not returned yet. Nobody tells of its return.
        if task._task_lock.locked():
            _deadlines.add(time.monotonic_ns() + STEP_CHECK_NS, self)
        with suppress(InvalidHandle):  # the executor was shut down
            executor.wake()

    # What has a deadline.

    def over(self) -> bool:
        """Whether it goes on by itself."""
        return self.awake

    def expire(self) -> None:
        """The step may be done."""
        self.wake()


def _task_waker(sleeper: _SleepingTask) -> Callable[[Any], None]:
    # The task leads to the future that it awaits.
    reference = weakref.ref(sleeper)

    def wake(_: Any) -> None:
        sleeping = reference()
        if sleeping is not None and not sleeping.awake:
            sleeping.wake()

    return wake


def _running_loop() -> asyncio.AbstractEventLoop | None:
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None


def _loop_waker(
    loop: asyncio.AbstractEventLoop, woken: asyncio.Future[None], delay_s: float
) -> Callable[[Any], None]:
    def end() -> None:
        if not woken.done():
            woken.set_result(None)

    def wake(_: Any) -> None:
        # Who awaited in a loop that is closed is gone.
        if not loop.is_closed():
            loop.call_soon_threadsafe(loop.call_later, delay_s, end)

    return wake


def _only_wakes(callback: Any) -> bool:
    return isinstance(callback, FunctionType) and callback.__module__ == EXECUTOR_MODULE
