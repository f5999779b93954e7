"""Complete futures of transforms, and wake the tasks and asyncio loops that await them."""

import os
import sys
import time
import weakref
from collections.abc import Callable, Generator
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

from geometry_msgs.msg import TransformStamped
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.task import Future, Task

from tf2_py import BufferCore, InvalidArgumentException, TimeoutException
from tf2_py._internal import call_despite_signals, errors
from tf2_ros._arguments import optional_timeout_ns
from tf2_ros._forking import FORKED, LOCK, is_inherited
from tf2_ros._nodes import Shutdown
from tf2_ros._rclpy import HookedFuture, is_in_step, only_wakes_executor, running_task, task_executor
from tf2_ros._wait.blocking import LongWait, Lookup, report_if_long
from tf2_ros._wait.callbacks import queue_of
from tf2_ros._wait.rounds import Waker, run_done_callbacks
from tf2_ros._wait.timers import deadlines

if TYPE_CHECKING:
    import asyncio

STEP_CHECK_NS = 2_000_000  # how often to check whether an executor has left the step of a task
CONTEXT_CHECK_NS = 100_000_000  # how often to check the contexts of what asyncio awaits


_Result = TypeVar("_Result")


class ContextCheck:
    """
    Ends what an asyncio loop awaits when a shutdown makes it pointless, while something refers to this.

    After a shutdown, an executor runs no tasks, but an asyncio loop continues. A signal shuts a context down
    without calling anything, so the thread of the deadlines checks the contexts while a loop awaits.
    """

    def __init__(self, future: "WakingFuture[Any]") -> None:
        self._future = weakref.ref(future)
        self.expire()

    def over(self) -> bool:
        """Whether the future no longer exists."""
        return self._future() is None

    def expire(self) -> None:
        """Check, and again after CONTEXT_CHECK_NS."""
        future = self._future()
        if future is None:
            return
        if future.is_in_vain():
            future.expire()
        else:
            deadlines.add(time.monotonic_ns() + CONTEXT_CHECK_NS, self)


class WakingFuture(HookedFuture, Generic[_Result]):
    """
    A future that may be completed in any thread, and wakes whatever runs the tasks that await it.

    :param in_vain: returns whether a shutdown has ended the wait. It is called while an asyncio loop awaits
        the future; :meth:`expire` then wakes the loop. None: no check.
    :param kept: the owner's references to what awaits this. Nothing else may refer to the task of an asyncio
        loop, which refers to its tasks only weakly.
    """

    if TYPE_CHECKING:  # rclpy's of Jazzy are not annotated

        def done(self) -> bool: ...
        def cancelled(self) -> bool: ...
        def result(self) -> _Result: ...
        def exception(self) -> BaseException | None: ...
        def add_done_callback(self, callback: Callable[[Any], object]) -> None: ...

    def __init__(self, in_vain: Callable[[], bool] | None = None, kept: "set[Any] | None" = None) -> None:
        super().__init__(LOCK)
        self.__in_vain = in_vain
        self.__kept = kept
        self.__process = os.getpid()

    def _tf2_run_callbacks(self, executor: Executor | None, callbacks: list[Callable[[Any], None]]) -> None:
        run_done_callbacks(self, executor, callbacks)

    def is_dead(self) -> bool:
        """Whether it is pending in a parent process, so that nothing completes it in this forked child."""
        return is_inherited(self.__process) and not self.done() and not self.cancelled()

    def __repr__(self) -> str:
        if self.is_dead():
            state = FORKED
        else:
            state = "done" if self.done() else "cancelled" if self.cancelled() else "pending"
        return f"<{type(self).__name__}: {state}>"

    def __await__(self) -> Generator[Any, Any, _Result]:
        if self.is_dead():
            raise RuntimeError(f"{self!r}: begin to wait in the process that awaits")
        try:
            return (yield from self.__wake_and_await())
        except BaseException as error:
            # The frames of this future's own methods refer to it, and it refers to the error, so only the
            # collector would free them.
            frames = error.__traceback__ and error.__traceback__.tb_next
            while frames is not None and frames.tb_frame.f_locals.get("self") is self:
                frames = frames.tb_next
            raise error.with_traceback(frames)  # noqa: B904  # the same error
        finally:
            del self

    def __wake_and_await(self) -> Generator[Any, Any, _Result]:
        # Callbacks that only wake must not keep a future alive, so no method of a subclass adds them.
        if self.done() or self.cancelled():
            pass  # and nothing has to be woken
        elif (task := running_task()) is not None:
            # An executor steps an awaiting task only when it has something else to do, and completing this
            # future gives it nothing to do.
            sleeper = _SleepingTask(task)
            del task
            Future.add_done_callback(self, sleeper)
            try:
                return cast(_Result, (yield from super().__await__()))
            finally:
                sleeper.awake = True
                Future.remove_done_callback(self, sleeper)
        elif (loop := _running_loop()) is not None:
            # Without this, asyncio would poll.
            waker = _LoopWaker(loop)
            kept = set() if self.__kept is None else self.__kept
            check = None if self.__in_vain is None else ContextCheck(self)
            try:
                kept.add(waker)
                Future.add_done_callback(self, waker)
                yield from waker.woken
            finally:
                del check
                # If the task was cancelled, leave nothing behind.
                Future.remove_done_callback(self, waker)
                kept.discard(waker)
        return cast(_Result, (yield from super().__await__()))

    def is_in_vain(self) -> bool:
        """Whether a shutdown has ended the wait."""
        return self.__in_vain is not None and self.__in_vain()

    def expire(self) -> None:
        """End the wait after a shutdown; called in any thread."""
        raise NotImplementedError


class _SleepingTask(Waker):
    """An awaiting task of an executor. This does not keep it alive, because it refers to the future."""

    def __init__(self, task: Task) -> None:
        self.awake = False
        self._task = weakref.ref(task)

    def __call__(self, _: object = None) -> None:
        """Have the executor step the task, once none of its threads does."""
        task = None if self.awake else self._task()
        executor = None if task is None else task_executor(task)
        if task is None or executor is None:
            return
        # An executor skips a task while another of its threads runs a step of it. That step may have decided
        # to sleep and not returned yet, and nothing reports its return.
        if is_in_step(task):
            deadlines.add(time.monotonic_ns() + STEP_CHECK_NS, self)
        with suppress(InvalidHandle):  # the executor was shut down
            executor.wake()

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Whether the task is awake."""
        return self.awake

    def expire(self) -> None:
        """Try again, because the step may be done."""
        self()


def _running_loop() -> "asyncio.AbstractEventLoop | None":
    # If a loop runs, asyncio is loaded. It is not imported here: that takes a tenth of the time of importing
    # tf2_ros, and in a forked child it could wait forever for a thread of the parent that was importing it.
    get_running_loop = getattr(sys.modules.get("asyncio"), "get_running_loop", None)
    if get_running_loop is None:
        return None
    try:
        loop: asyncio.AbstractEventLoop = get_running_loop()
    except RuntimeError:
        return None
    return loop


class _LoopWaker(Waker):
    """What a task of an asyncio loop awaits: ``woken``, which refers to the task."""

    def __init__(self, loop: "asyncio.AbstractEventLoop") -> None:
        self._loop = loop
        self.woken: asyncio.Future[None] = loop.create_future()

    def __call__(self, _: object) -> None:
        # In a closed loop, nothing awaits any more.
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._end)

    def _end(self) -> None:
        if not self.woken.done():
            self.woken.set_result(None)


class TransformFuture(WakingFuture[TransformStamped]):
    """
    The future of a transform that a buffer may not have yet.

    :param lookup: what to wait for. Invalid arguments raise, except an invalid name, which ends the future at
        once.
    :param timeout: an rclpy Duration of steady time, after which the future holds a TimeoutException. None or
        an infinite one: never.

    The thread that inserts the missing data completes it. Callbacks are user code, so if a receiver inserts
    the data, the executor of the listener's node completes a future that has callbacks.

    The wait continues as long as something refers to the future. The buffer does if the future has a callback
    or is awaited.

    Everything that ends the wait may be called several times, so that it can be repeated when a signal
    handler has cut it short.
    """

    # Two leading underscores keep these names apart from those of rclpy's Future in any release.

    def __init__(self, core: BufferCore, lookup: Lookup, timeout: Any = None) -> None:
        self.__shutdown = Shutdown(core)
        self.__kept: set[Any] = core._tf2_kept
        super().__init__(self.__shutdown.happened, self.__kept)
        self.__begin_ns = time.monotonic_ns()
        self.__timeout_ns = optional_timeout_ns(timeout)
        # How many were added by anything but an executor. Guarded by LOCK; they decide which thread completes
        # this.
        self.__callbacks = 0
        self.__core: BufferCore | None = core
        self.__wait: Any = None
        self.__report: LongWait | None = None
        try:
            wait = self.__wait = lookup.wait(core, _notify(weakref.ref(self)))
        except InvalidArgumentException as error:
            self.fail(error)
            return
        # From here on, another thread may complete this at any time.
        answer = wait.answer
        if answer is not None:
            self.succeed(answer)
        elif wait.is_hopeless:
            self.fail(wait.reason())
        if self.over():
            self.__wait = self.__core = None
            return
        if self.__timeout_ns is not None:
            deadlines.add(self.__begin_ns + self.__timeout_ns, self)
        self.__report = report_if_long([wait])

    def answered(self, answer: Any) -> Callable[[], None] | None:
        """
        Complete this; or, if that runs callbacks, return the function that does.

        :param answer: None: there will never be one.
        """
        if self.is_dead():
            return None
        if answer is not None:
            return self.__end_or_return(partial(Future.set_result, self, answer))
        wait = self.__wait
        return None if wait is None else self.__end_or_return(self.__failure(wait.reason()))

    def succeed(self, answer: Any) -> None:
        """Complete this with the answer."""
        self.__end(partial(Future.set_result, self, answer))

    def fail(self, error: BaseException) -> None:
        """Complete this with an error."""
        self.__end(self.__failure(error))

    def over(self) -> bool:
        """Whether the wait has ended in any way."""
        return bool(self.done() or self.cancelled())

    def cancel(self) -> None:
        """End the wait; without effect if it has an outcome."""
        self.__end(partial(Future.cancel, self))

    def set_result(self, result: Any) -> None:
        """End the wait with this result."""
        super().set_result(result)
        self.__release()

    def set_exception(self, exception: BaseException) -> None:
        """End the wait with this exception."""
        super().set_exception(exception)
        self.__release()

    def add_done_callback(self, callback: Callable[[Any], object]) -> None:
        """Add a callback; from now on it keeps the future alive."""
        if not only_wakes_executor(callback):
            with LOCK:
                if not self.over():
                    self.__callbacks += 1
                    self.__kept.add(self)
                    super().add_done_callback(callback)
                    if self.over():  # a finalizer ended it meanwhile
                        self.__kept.discard(self)
                    return
        super().add_done_callback(callback)

    def remove_done_callback(self, callback: Callable[[Any], None]) -> bool:
        """Remove a callback; whether it had been added."""
        with LOCK:
            removed: bool = super().remove_done_callback(callback)
            if removed and not only_wakes_executor(callback):
                self.__callbacks -= 1
                if self.__callbacks == 0:
                    self.__kept.discard(self)
        return removed

    def expire(self) -> None:
        """
        End at the timeout, or because the context was shut down: with the answer if it has just arrived, or
        with a TimeoutException.
        """
        wait, core = self.__wait, self.__core
        if wait is None or core is None:
            return
        wait.cancel()
        answer = wait.answer
        if answer is not None:
            rest = self.answered(answer)
        else:
            error = _unanswered(self.__shutdown, self.__begin_ns, self.__timeout_ns, wait.reason)
            rest = self.__end_or_return(self.__failure(error))
        if rest is not None:
            queue_of(core).put(rest)

    def __failure(self, error: BaseException) -> Callable[[], None]:
        # Its traceback refers to this future, so only the collector would free both.
        return partial(Future.set_exception, self, error.with_traceback(None))

    def __end_or_return(self, set_outcome: Callable[[], None]) -> Callable[[], None] | None:
        # Ends this if that runs no user code; otherwise returns the function that ends it.
        with LOCK:
            if self.__callbacks:
                return partial(call_despite_signals, partial(self.__end, set_outcome))
            self.__set(set_outcome)
        self.__complete()
        return None

    def __end(self, set_outcome: Callable[[], None]) -> None:
        self.__set(set_outcome)
        self.__complete()

    def __set(self, set_outcome: Callable[[], None]) -> None:
        # Of all threads that try to end the wait, the first one sets the outcome.
        with LOCK:
            if not self.over():
                set_outcome()

    def __complete(self) -> None:
        self.__release()
        self._tf2_completed()

    def __release(self) -> None:
        wait, self.__wait, self.__core = self.__wait, None, None  # they hold the buffer
        self.__report = None
        if wait is not None:
            wait.cancel()
        self.__kept.discard(self)


def _notify(reference: "weakref.ref[TransformFuture]") -> Callable[[Any], Callable[[], None] | None]:
    # The engine refers to this as long as the future waits; it must not keep the future alive.
    def notify(answer: Any) -> Callable[[], None] | None:
        future = reference()
        return None if future is None else future.answered(answer)

    return notify


def _unanswered(
    shutdown: Shutdown, begin_ns: int, timeout_ns: int | None, reason: Callable[[], object]
) -> TimeoutException:
    """
    Make the exception of a future that ends without an answer.

    :param begin_ns: the steady time at which it began to wait.
    :param reason: returns the reason of the lookup, for a wait that timed out.
    """
    waited_ns = time.monotonic_ns() - begin_ns
    if timeout_ns is not None:
        waited_ns = min(waited_ns, timeout_ns)
    if shutdown.happened():
        return TimeoutException(errors.shut_down(waited_ns))
    return TimeoutException(errors.timed_out(reason(), waited_ns))
