"""Owns waking whatever awaits a future: a task of an executor, or an asyncio loop."""

import asyncio
import time
import warnings
import weakref
from collections.abc import Callable, Generator
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.task import Future, Task

from tf2_ros._forking import LOCK
from tf2_ros._rclpy import HookedFuture, is_in_step, running_task, task_executor
from tf2_ros._wait.contexts import await_checks
from tf2_ros._wait.deadlines import deadlines

__all__ = ["GRACE_S", "WakingFuture"]

GRACE_S = 1.0  # for an executor to complete a future whose outcome is known
STEP_CHECK_NS = 2_000_000  # how often to check whether an executor has left the step of a task


_Result = TypeVar("_Result")


class WakingFuture(HookedFuture, Generic[_Result]):
    """
    A future that may be completed in any thread: it wakes whatever runs the tasks that await it.

    :param in_vain: whether a shutdown has ended the wait; asked while an asyncio loop awaits it, which
        :meth:`end_with_context` then wakes. None: nothing asks.
    """

    if TYPE_CHECKING:  # rclpy's of Jazzy are not annotated

        def done(self) -> bool: ...
        def cancelled(self) -> bool: ...
        def result(self) -> _Result: ...
        def exception(self) -> BaseException | None: ...
        def add_done_callback(self, callback: Callable[[Any], object]) -> None: ...

    def __init__(self, in_vain: Callable[[], bool] | None = None) -> None:
        super().__init__(LOCK)
        self.__in_vain = in_vain

    def _tf2_run_callbacks(self, executor: Executor | None, callbacks: list[Callable[[Any], None]]) -> None:
        # rclpy's own way leaves out those behind one that raises more than an Exception.
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

    def __await__(self) -> Generator[Any, Any, _Result]:
        try:
            return (yield from self.__wake_and_await())
        except BaseException as error:
            # The frames of this future's own methods hold it, and it holds the error: only the collector
            # would free them.
            frames = error.__traceback__ and error.__traceback__.tb_next
            while frames is not None and frames.tb_frame.f_locals.get("self") is self:
                frames = frames.tb_next
            raise error.with_traceback(frames)  # noqa: B904  # it is the same one
        finally:
            del self

    def __wake_and_await(self) -> Generator[Any, Any, _Result]:
        # Callbacks that only wake do not keep a future alive: they are not added by a subclass's method.
        sleeper = _SleepingTask.current()
        if sleeper is not None:
            # An executor steps a task that awaits only when it has something else to do, and completing this
            # future gives it nothing to do.
            Future.add_done_callback(self, _task_waker(sleeper))
            try:
                return cast(_Result, (yield from super().__await__()))
            finally:
                sleeper.awake = True
        if (loop := _running_loop()) is not None:
            # asyncio would poll instead.
            woken = loop.create_future()
            Future.add_done_callback(self, _loop_waker(loop, woken, 0.0))
            self._wake_when_known(_loop_waker(loop, woken, GRACE_S))
            is_checked = self.__in_vain is not None and not self.done()
            key = await_checks.begin(self) if is_checked else None
            try:
                yield from woken
            finally:
                if is_checked:
                    await_checks.end(key)
            if not self.done() and not self.cancelled():
                return self._known_outcome()
        return cast(_Result, (yield from super().__await__()))

    def _wake_when_known(self, waker: Callable[[Any], None]) -> None:
        """Call this, in whatever thread, when the outcome is known before the future is done."""

    def is_in_vain(self) -> bool:
        """Whether a shutdown has ended the wait."""
        return self.__in_vain is not None and self.__in_vain()

    def end_with_context(self) -> None:
        """The wait is in vain; called in any thread."""
        raise NotImplementedError

    def _known_outcome(self) -> _Result:
        """The outcome of a future that is not done, but has woken what awaits it."""
        raise NotImplementedError


class _SleepingTask:
    """A task of an executor that awaits. It is not kept alive: it refers to the future that it awaits."""

    def __init__(self, task: Task) -> None:
        self.awake = False
        self._task = weakref.ref(task)

    @classmethod
    def current(cls) -> "_SleepingTask | None":
        """The one that executes the caller."""
        task = running_task()
        return None if task is None else cls(task)

    def wake(self) -> None:
        """Have the executor step the task, when none of its threads does."""
        task = self._task()
        executor = None if task is None else task_executor(task)
        if task is None or executor is None:
            return
        # An executor skips a task whose step another of its threads executes: that step may have decided to
        # sleep, and not returned yet. Nothing reports its return.
        if is_in_step(task):
            deadlines.add(time.monotonic_ns() + STEP_CHECK_NS, self)
        with suppress(InvalidHandle):  # the executor was shut down
            executor.wake()

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Whether it runs by itself."""
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
        # Nothing awaits any more in a loop that is closed.
        if not loop.is_closed():
            loop.call_soon_threadsafe(loop.call_later, delay_s, end)

    return wake
