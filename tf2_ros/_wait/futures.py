"""Complete futures of transforms, wake the tasks and asyncio loops that await them, and follow changes."""

import os
import time
import weakref
from collections.abc import Callable, Generator
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from geometry_msgs.msg import TransformStamped
from rclpy.executors import Executor
from rclpy.task import Future, Task

from tf2_py import BufferCore, InvalidArgumentException, TimeoutException
from tf2_py._internal import errors
from tf2_ros._arguments import optional_timeout_ns
from tf2_ros._forking import FORKED, LiveObjects, is_inherited
from tf2_ros._node_lifetimes import Shutdown
from tf2_ros._rclpy import (
    HEEDS_FUTURES,
    RESUMES_TASKS,
    end_round,
    has_locked_tasks,
    is_in_step,
    resume,
    running_loop,
    running_task,
    spun_executor,
    task_executor,
)
from tf2_ros._wait.call_queue import call_queue_for, put_or_call
from tf2_ros._wait.call_runners import without_node
from tf2_ros._wait.deadlines import deadlines
from tf2_ros._wait.endings import FutureEnding, Waker, notify

if TYPE_CHECKING:
    import asyncio

STEP_CHECK_NS = 2_000_000  # how often to check whether an executor has left the step of a task
SHUTDOWN_CHECK_NS = 100_000_000  # how often to check the contexts of what asyncio awaits
CLOCK_CHECK_NS = 100_000_000  # how often to check whether simulated time has begun


_Result = TypeVar("_Result")


class WakingFuture(FutureEnding, Future, Generic[_Result]):
    """
    A future that may be completed in any thread, and wakes whatever runs the tasks that await it.

    :param is_in_vain: returns whether a shutdown has ended the wait. It is called while an asyncio loop
        awaits the future, which :meth:`expire` then ends. Futures with an equal one share the check.
    :param kept: the owner's references to futures that have callbacks, and to what awaits them. Nothing else
        may refer to these: an asyncio loop refers to its tasks only weakly.

    If it is cancelled, the callbacks run in that thread, also if they were queued with an outcome already.
    Whatever awaits it wakes, and gets None, as from rclpy's own. To cancel a coroutine that awaits it, cancel
    its task, see ``__await__``.
    """

    # Two leading underscores keep these names apart from those of rclpy's Future in any release.

    def __init__(
        self, is_in_vain: Callable[[], bool] = lambda: False, kept: dict[Any, None] | None = None
    ) -> None:
        super().__init__()
        self.is_in_vain = is_in_vain
        self.kept = {} if kept is None else kept
        self.__process = os.getpid()

    if TYPE_CHECKING:

        def result(self) -> _Result: ...

    def is_dead(self) -> bool:
        """Whether it is pending in a parent process, so that nothing completes it in this forked child."""
        return is_inherited(self.__process) and not self.has_ended()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {FORKED if self.is_dead() else self.state}>"

    def __await__(self) -> Generator[Any, Any, _Result]:
        """
        Sleep until it has ended; then return its result, None if it was cancelled, or raise its exception.

        Where the awaiting coroutine is cancelled or closed, Python raises at the ``yield``, and what would
        have woken it is removed. The future itself is not cancelled: it waits on as long as something refers
        to it. Usually only the coroutine and the traceback of the cancellation do, and its waiter ends with
        them, because the engine refers to the future weakly (``notify``).
        """
        if self.is_dead():
            raise RuntimeError(f"{self!r}: create the future after the fork")
        if not self.has_ended():
            sleeper = _sleeper(self)
            try:
                self.kept[sleeper] = None
                self.add_done_callback(sleeper)
                yield from sleeper.sleep(self)
            finally:
                sleeper.awake = True
                self.remove_done_callback(sleeper)
                self.kept.pop(sleeper, None)
                if self.has_ended():
                    self.exception()  # of a cancelled coroutine, nobody else fetches it
        return self.result()

    if not HEEDS_FUTURES:

        def add_done_callback(self, callback: Callable[[Any], object]) -> None:
            """Add a callback; for that of an executor that spins until this has ended, what ends the spin."""
            executor = spun_executor(callback)
            if executor is None:
                super().add_done_callback(callback)
            elif not any(getattr(waker, "spun", None) is executor for waker in self.wakers):
                super().add_done_callback(_SpunExecutor(executor))

    def expire(self) -> None:
        """End the wait after a shutdown: with None, unless a subclass does more. Called in any thread."""
        self.end()


class _SpunExecutor(Waker):
    """What ends the spin of an executor until a future, in releases where waking it is not enough."""

    def __init__(self, executor: Executor) -> None:
        self.spun = executor

    def __call__(self, _: object) -> None:
        call = partial(end_round, self.spun)
        if has_locked_tasks(self.spun):
            without_node.put(call)  # a thread waits for the lock, which a signal handler must not
        else:
            call()


class _SleepingTask(Waker):
    """
    What wakes a task of an executor, to which it refers weakly, because the task refers to the future.

    :param task: None: something else awaits, which must resume the coroutine until it ends.
    """

    def __init__(self, task: Task | None) -> None:
        self.awake = False
        self._task = None if task is None else weakref.ref(task)
        self._yielded: weakref.ref[Future] | None = None  # it refers to the task, and the task to it

    def sleep(self, future: WakingFuture[Any]) -> Generator[Any, Any, None]:
        """Sleep until the future has ended."""
        while not future.has_ended():
            # Where tasks are resumed, one that yields None is stepped again in the next round, at once.
            yielded: Future | None = Future() if RESUMES_TASKS and self._has_executor() else None
            self._yielded = None if yielded is None else weakref.ref(yielded)
            yield yielded

    def __call__(self, _: object = None) -> None:
        """Have the executor step the task, once none of its threads does."""
        task = None if self._task is None or self.awake else self._task()
        executor = None if task is None else task_executor(task)
        if task is None or executor is None:
            return
        # An executor skips a task while another of its threads runs a step of it. That step may have decided
        # to sleep and not returned yet, and nothing reports its return.
        #   in a step  tasks locked  now     later, too
        #   no         no            resume  no
        #   unknown    no            resume  yes, because it may have been skipped
        #   yes        any           no      yes
        #   any        yes           no      yes, because a signal handler must not wait for the lock
        in_step, is_locked = is_in_step(task), has_locked_tasks(executor)
        if not in_step and not is_locked:
            resume(task, executor, None if self._yielded is None else self._yielded())
        if in_step is not False or is_locked:
            deadlines.add(time.monotonic_ns() + STEP_CHECK_NS, self)  # last: there may be no thread for it

    def _has_executor(self) -> bool:
        task = None if self._task is None else self._task()
        return task is not None and task_executor(task) is not None

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Whether the task is awake."""
        return self.awake

    def expire(self) -> None:
        """Try again, because the step may be done."""
        self()


class _SleepingLoop(Waker):
    """What wakes a task of an asyncio loop, which otherwise would poll. It awaits ``_woken``."""

    def __init__(self, loop: "asyncio.AbstractEventLoop", future: WakingFuture[Any]) -> None:
        self.awake = False
        self.future = future
        self._loop = loop
        self._woken: asyncio.Future[None] = loop.create_future()
        self._check: _ShutdownCheck | None = None  # which ends with the last one that refers to it

    def sleep(self, _: object) -> Generator[Any, Any, None]:
        """Sleep until the future has ended."""
        if self.future.is_in_vain():
            self.future.expire()
        else:
            self._check = _ShutdownCheck.of(self._loop, self.future.is_in_vain)
            self._check.sleepers.add(self)
        yield from self._woken

    def __call__(self, _: object) -> None:
        try:
            self._loop.call_soon_threadsafe(self._end)
        except RuntimeError:  # the loop is closed, so its task will never take this out
            self.future.kept.pop(self, None)

    def _end(self) -> None:
        if not self._woken.done():
            self._woken.set_result(None)


class _ShutdownCheck:
    """
    Regularly checks whether a shutdown has ended the futures that tasks of a loop await, once for them all.

    After a shutdown, an executor runs no tasks, but an asyncio loop continues. A signal shuts a context down
    without calling anything, so the thread of the deadlines checks the contexts while a loop awaits.
    """

    _known: "dict[tuple[asyncio.AbstractEventLoop, Callable[[], bool]], weakref.ref[_ShutdownCheck]]" = {}

    def __init__(self, loop: "asyncio.AbstractEventLoop", is_in_vain: Callable[[], bool]) -> None:
        self._loop, self._is_in_vain = loop, is_in_vain
        self.sleepers: LiveObjects[_SleepingLoop] = LiveObjects()
        self._check_later()

    @classmethod
    def of(cls, loop: "asyncio.AbstractEventLoop", is_in_vain: Callable[[], bool]) -> "_ShutdownCheck":
        """The check for futures with this `is_in_vain`; called in the thread of the loop."""
        key = loop, is_in_vain
        known = cls._known.get(key)
        check = None if known is None else known()
        if check is None:
            check = cls(loop, is_in_vain)
            cls._known[key] = weakref.ref(check, partial(cls._known.pop, key))
        return check

    def _check_later(self) -> None:
        deadlines.add(time.monotonic_ns() + SHUTDOWN_CHECK_NS, self)

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Whether no task of the loop will wake, because it is closed."""
        if self._loop.is_closed():
            for sleeper in self.sleepers:
                sleeper.future.kept.pop(sleeper, None)
        return self._loop.is_closed()

    def expire(self) -> None:
        """End the futures if they wait in vain, and check again after SHUTDOWN_CHECK_NS."""
        self._check_later()
        if self._is_in_vain():
            for sleeper in self.sleepers:
                if not sleeper.awake:
                    sleeper.future.expire()


# A forked child has neither the loops nor the deadlines.
os.register_at_fork(after_in_child=_ShutdownCheck._known.clear)


def _sleeper(future: WakingFuture[Any]) -> _SleepingTask | _SleepingLoop:
    """What wakes whatever runs in this thread."""
    loop = running_loop()
    # A callback that an executor runs may run a loop, and a task of a loop may spin an executor.
    task = running_task(is_direct=loop is not None)
    return _SleepingTask(task) if task is not None or loop is None else _SleepingLoop(loop, future)


class TransformFuture(WakingFuture[TransformStamped]):
    """
    The future of a transform that a buffer may not have yet.

    :param begin: begins to wait, such as ``Lookup.wait``. Invalid arguments raise, except an invalid name,
        which ends the future at once.
    :param timeout: an rclpy Duration of steady time, after which the future holds a TimeoutException. None or
        an infinite one: never.
    :param begin_ns: the steady time from which the timeout counts. None: now.

    If the program itself inserts the missing data, the thread that does completes the future, and runs its
    callbacks. If a listener receives it, a future without callbacks is completed at once, in any thread; one
    with callbacks is queued, and completed together with them in the executor that spins the listener's node;
    until then no timeout ends it. The timeout ends a pending one in the executor that has the node of the
    buffer's latest listener; if none does at that moment, in the thread of the deadlines.

    The wait continues as long as something refers to the future. The buffer does if the future has a callback
    or asyncio awaits it.
    """

    def __init__(
        self,
        core: BufferCore,
        begin: Callable[..., Any],
        timeout: Any = None,
        begin_ns: int | None = None,
    ) -> None:
        super().__init__(Shutdown(core), getattr(core, "_tf2_kept", None))
        self.__core = weakref.ref(core)  # which the wait keeps
        self.__begin_ns = time.monotonic_ns() if begin_ns is None else begin_ns
        self.__timeout_ns = optional_timeout_ns(timeout)
        try:
            # The engine refers to what is notified as long as this waits; it must not keep this alive.
            wait = self.wait = begin(core, partial(notify, weakref.ref(self)))
        except InvalidArgumentException as error:
            self.set_exception(error)
            return
        # From here on, another thread may complete this at any time.
        answer = wait.take()
        if answer is not None:
            self.set_result(answer)
        if self.over():
            self.wait = None
            return
        if self.__timeout_ns is not None:
            deadlines.add(self.__begin_ns + self.__timeout_ns, self)
        if wait.must_be_tried:
            self.__clock_check = _ClockCheck(self)

    def expire(self) -> None:
        """
        End at the timeout, or because the context was shut down: with the answer if it has just arrived, or
        with a TimeoutException.
        """
        self.retry()
        wait = self.wait
        if wait is not None and not self.over():
            self.__end(None, self.__unanswered(wait))

    def retry(self) -> None:
        """End with an answer that is fresh by the clock, if there is one."""
        wait = self.wait
        try:
            answer = None if wait is None else wait.take()
        except ValueError as error:  # a limit for a frame that is not a child
            self.__end(None, error)
        else:
            if answer is not None:
                self.__end(answer, None)

    def __end(self, answer: TransformStamped | None, error: Exception | None) -> None:
        put_or_call(call_queue_for(self.__core()), self.end_or_queue(answer, error))

    def __unanswered(self, wait: Any) -> TimeoutException:
        waited_ns = time.monotonic_ns() - self.__begin_ns
        if self.__timeout_ns is not None:
            waited_ns = min(waited_ns, self.__timeout_ns)
        if self.is_in_vain():
            return TimeoutException(errors.shut_down(waited_ns))
        return TimeoutException(errors.timed_out(wait.reason(), waited_ns))


class _ClockCheck:
    """
    Regularly retries a future that judges ages, until simulated time begins, as long as something else refers
    to it. Nothing reports that.
    """

    def __init__(self, future: TransformFuture) -> None:
        self._future = weakref.ref(future)
        self._check_later()

    def _check_later(self) -> None:
        deadlines.add(time.monotonic_ns() + CLOCK_CHECK_NS, self)

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Whether the future needs no check any more."""
        future = self._future()
        return future is None or future.over()

    def expire(self) -> None:
        """Retry, and check again after CLOCK_CHECK_NS."""
        future = self._future()
        if future is not None:
            self._check_later()
            future.retry()


class Changes:
    """
    An asynchronous iterator over the transforms between two frames, each when it is new.

    :param buffer: kept alive by this.
    """

    def __init__(self, buffer: BufferCore, target_frame: str, source_frame: str) -> None:
        self._buffer, self._frames = buffer, (target_frame, source_frame)
        self._begun: Any = None  # the latest wait
        self._delivered: Any = None  # the wait that had the transform delivered last

    def __aiter__(self) -> "Changes":
        return self

    async def __anext__(self) -> TransformStamped:
        future = TransformFuture(self._buffer, self._begin)
        try:
            found = await future
        except TimeoutException:  # without a timeout: a shutdown
            raise StopAsyncIteration from None
        finally:
            future.cancel()  # after a cancelled step, what this refers to would go on waiting
        self._delivered = self._begun
        return found

    def _begin(self, core: BufferCore, notify: Callable[[Any], Any]) -> Any:
        self._begun = BufferCore._wait(core, *self._frames, 0, notify=notify, after=self._delivered)
        return self._begun
