"""Complete futures of transforms, and wake the tasks and asyncio loops that await them."""

import sys
import time
import warnings
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
from tf2_py._internal import errors
from tf2_ros._arguments import optional_timeout_ns
from tf2_ros._forking import FORKED, LOCK, generation
from tf2_ros._nodes import Shutdown
from tf2_ros._rclpy import HookedFuture, is_in_step, only_wakes_executor, running_task, task_executor
from tf2_ros._wait.blocking import POLL_PERIOD_S, LongWait, Lookup, report_if_long
from tf2_ros._wait.callbacks import call_all, queue_of
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
        self.__generation = generation()

    def _tf2_run_callbacks(self, executor: Executor | None, callbacks: list[Callable[[Any], None]]) -> None:
        # rclpy does not call those behind one that raises a BaseException.
        call_all(partial(self.__run_callback, executor, callback) for callback in callbacks)

    def __run_callback(self, executor: Executor | None, callback: Callable[[Any], None]) -> None:
        try:
            if executor is None:
                callback(self)
            else:
                executor.create_task(callback, self)
        except Exception as error:
            warnings.warn(f"Unhandled exception in done callback: {error}", stacklevel=2)

    def is_dead(self) -> bool:
        """Whether it is pending in a parent process, so that nothing completes it in this forked child."""
        return self.__generation != generation() and not self.done() and not self.cancelled()

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
        if (task := running_task()) is not None:
            # An executor steps an awaiting task only when it has something else to do, and completing this
            # future gives it nothing to do.
            sleeper = _SleepingTask(task)
            del task
            Future.add_done_callback(self, sleeper.wake)
            try:
                return cast(_Result, (yield from super().__await__()))
            finally:
                sleeper.awake = True
                Future.remove_done_callback(self, sleeper.wake)
        if (loop := _running_loop()) is not None:
            # Without this, asyncio would poll.
            woken = loop.create_future()
            waker = _loop_waker(loop, woken)
            Future.add_done_callback(self, waker)
            check = None if self.__in_vain is None or self.done() else ContextCheck(self)
            try:
                yield from woken
            finally:
                del check
                # If the task was cancelled, leave nothing behind.
                Future.remove_done_callback(self, waker)
        return cast(_Result, (yield from super().__await__()))

    def is_in_vain(self) -> bool:
        """Whether a shutdown has ended the wait."""
        return self.__in_vain is not None and self.__in_vain()

    def expire(self) -> None:
        """End the wait after a shutdown; called in any thread."""
        raise NotImplementedError


class _SleepingTask:
    """An awaiting task of an executor. This does not keep it alive, because it refers to the future."""

    def __init__(self, task: Task) -> None:
        self.awake = False
        self._task = weakref.ref(task)

    def wake(self, _: object = None) -> None:
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
        self.wake()


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


def _loop_waker(loop: "asyncio.AbstractEventLoop", woken: "asyncio.Future[None]") -> Callable[[Any], None]:
    def end() -> None:
        if not woken.done():
            woken.set_result(None)

    def wake(_: Any) -> None:
        # In a closed loop, nothing awaits any more.
        if not loop.is_closed():
            loop.call_soon_threadsafe(end)

    return wake


class TransformFuture(WakingFuture[TransformStamped]):
    """
    The future of a transform that a buffer may not have yet.

    :param lookup: what to wait for. Invalid arguments raise, except an invalid name, which ends the future at
        once.
    :param asked: two functions instead of ``lookup``, because a program has replaced methods: the first
        returns whether there is an answer and why not, as ``can_transform_core`` does, the second returns the
        answer. They are called after each insert and every POLL_PERIOD_S, because their answers may depend on
        anything.
    :param timeout: an rclpy Duration of steady time, after which the future holds a TimeoutException. None or
        an infinite one: never.

    The thread that inserts the missing data completes it. Callbacks are user code, so if a receiver inserts
    the data, the executor of the listener's node completes a future that has callbacks.

    The future exists, and the wait continues, as long as something refers to it or it has a callback.
    """

    # The futures that have callbacks, which keep them alive.
    _kept_alive: "set[TransformFuture]" = set()

    # Two leading underscores keep these names apart from those of rclpy's Future in any release.

    def __init__(
        self, core: BufferCore, lookup: Lookup, timeout: Any = None, asked: "Asked | None" = None
    ) -> None:
        self.__shutdown = Shutdown(core)
        super().__init__(self.__shutdown.happened)
        self.__begin_ns = time.monotonic_ns()
        self.__timeout_ns = optional_timeout_ns(timeout)
        # How many were added by anything but an executor. Guarded by LOCK; they decide which thread completes
        # this.
        self.__callbacks = 0
        # Whether a thread is inside `__end_with`, under LOCK; and whether callbacks, which only wake, are to
        # be called after it.
        self.__ending = self.__is_due = False
        self.__claims = [None]  # the thread that pops it ends the wait
        self.__core: BufferCore | None = core
        self.__wait: Any = None
        self.__report: LongWait | None = None
        self.__poll: _Poll | None = None
        if asked is not None:
            self.__poll = _Poll(self, core, asked)
            self.__poll.check()
            if self.__timeout_ns is not None and not self.over():
                deadlines.add(self.__begin_ns + self.__timeout_ns, self)
            return
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
        if answer is None:
            return self.__end_in_vain()
        return self.__end_with(partial(self.succeed, answer))

    def succeed(self, answer: Any) -> None:
        """Complete this with the answer."""
        if self.__claim():
            super().set_result(answer)

    def fail(self, error: BaseException) -> None:
        """Complete this with an error."""
        if self.__claim():
            # Its traceback refers to this future, so only the collector would free both.
            super().set_exception(error.with_traceback(None))

    def over(self) -> bool:
        """Whether the wait has ended in any way."""
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

    def __end_in_vain(self) -> Callable[[], None] | None:
        wait = self.__wait
        if wait is None:
            return None
        return self.__end_with(partial(self.fail, wait.reason()))

    def expire(self) -> None:
        """
        End at the timeout, or because the context was shut down: with the answer if it has just arrived, or
        with a TimeoutException.
        """
        wait, core, poll = self.__wait, self.__core, self.__poll
        if core is not None and poll is not None:
            queue_of(core).put(partial(self.__end_poll, poll))
        if wait is None or core is None:
            return
        wait.cancel()
        answer = wait.answer
        if answer is not None:
            rest = self.answered(answer)
        else:
            error = _unanswered(self.__shutdown, self.__begin_ns, self.__timeout_ns, wait.reason)
            rest = self.__end_with(partial(self.fail, error))
        if rest is not None:
            queue_of(core).put(rest)

    def __end_with(self, end: Callable[[], None]) -> Callable[[], None] | None:
        # Ends this if that runs no user code; otherwise returns the function that ends it.
        with LOCK:
            if self.__callbacks:
                return end
            self.__ending, self.__is_due = True, False
            end()
            self.__ending = False
        if self.__is_due:
            self._tf2_completed()
        return None

    def _tf2_completed(self) -> None:
        with LOCK:
            if self.__ending:
                self.__is_due = True
                return
        super()._tf2_completed()

    def __end_poll(self, poll: "_Poll") -> None:
        reason = poll.ask()
        if reason is not None:
            self.fail(_unanswered(self.__shutdown, self.__begin_ns, self.__timeout_ns, lambda: reason))

    def __claim(self) -> bool:
        # Of all threads that try to end the wait, one gets True, and ends it.
        try:
            self.__claims.pop()
        except IndexError:
            return False
        wait, self.__wait, self.__core = self.__wait, None, None  # they hold the buffer
        poll, self.__poll, self.__report = self.__poll, None, None
        if poll is not None:
            poll.end()
        if wait is not None:
            wait.cancel()
        TransformFuture._kept_alive.discard(self)
        return True


Asked = tuple[Callable[[], tuple[Any, str]], Callable[[], Any]]


class _Poll:
    """Calls replaced methods of a program repeatedly, for a future that it does not keep alive."""

    def __init__(self, future: TransformFuture, core: BufferCore, asked: Asked) -> None:
        self._future = weakref.ref(future)
        self._core = core
        self._can, self._look_up = asked
        core._tf2_observers.append(self.ask)

    def end(self) -> None:
        """Stop asking."""
        with suppress(ValueError):
            self._core._tf2_observers.remove(self.ask)

    def ask(self) -> str | None:
        """End the future, if there is an answer or an error; otherwise return why there is none."""
        future = self._future()
        if future is None or future.over():
            self.end()
            return None
        try:
            can, reason = self._can()
            if not can:
                return reason
            future.succeed(self._look_up())
        except BaseException as error:
            future.fail(error)
        return None

    def check(self) -> None:
        """Ask now and later."""
        if self.ask() is not None:
            deadlines.add(time.monotonic_ns() + int(POLL_PERIOD_S * 1e9), self)

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Whether asking has ended."""
        future = self._future()
        return future is None or future.over()

    def expire(self) -> None:
        """Ask, in the thread that runs code of a program."""
        queue_of(self._core).put(self.check)


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
