"""Complete futures of transforms, and wake the tasks and asyncio loops that await them."""

import os
import sys
import time
import weakref
from collections.abc import Callable, Generator
from contextlib import suppress
from enum import Enum
from threading import get_ident
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar, cast

from geometry_msgs.msg import TransformStamped
from rclpy.exceptions import InvalidHandle
from rclpy.task import Future, Task

from tf2_py import BufferCore, InvalidArgumentException, TimeoutException
from tf2_py._internal import errors
from tf2_ros._arguments import optional_timeout_ns
from tf2_ros._forking import FORKED, LOCK, is_inherited
from tf2_ros._nodes import Shutdown
from tf2_ros._rclpy import is_in_step, running_task, task_executor
from tf2_ros._wait.blocking import Lookup
from tf2_ros._wait.callbacks import call_in_executor, queue_of
from tf2_ros._wait.rounds import Ending, Waker, finalize, only_wakes, run_done_callbacks
from tf2_ros._wait.timers import deadlines

if TYPE_CHECKING:
    import asyncio

STEP_CHECK_NS = 2_000_000  # how often to check whether an executor has left the step of a task
SHUTDOWN_CHECK_NS = 100_000_000  # how often to check the contexts of what asyncio awaits


_Result = TypeVar("_Result")


class State(Enum):
    """
    The life of a future, from the first to one of the last two. ``LOCK`` guards each step.

    An outcome that is queued is not visible: ``done()`` is False, and cancelling replaces it.
    """

    PENDING = "pending"
    QUEUED = "queued"  # it has an outcome; the thread that runs its callbacks will complete it with them
    DONE = "done"
    CANCELLED = "cancelled"


class Outcome(NamedTuple):
    """How a future ends."""

    state: State
    result: Any = None
    error: BaseException | None = None


class WakingFuture(Future, Generic[_Result]):
    """
    A future that may be completed in any thread, and wakes whatever runs the tasks that await it.

    :param in_vain: returns whether a shutdown has ended the wait. It is called while an asyncio loop awaits
        the future, which :meth:`expire` then ends. None: no check.
    :param kept: the owner's references to futures that have callbacks, and to what awaits them. Nothing else
        may refer to these: an asyncio loop refers to its tasks only weakly.

    The first outcome counts. What ends the future may be called several times, so that it can be repeated
    where a signal handler has cut it short; each callback is called once.
    """

    # The finalizer reads it, also if a signal handler has cut __init__ short.
    _exception: BaseException | None = None

    __del__: Any = finalize

    # Two leading underscores keep these names apart from those of rclpy's Future in any release.

    def __init__(self, in_vain: Callable[[], bool] | None = None, kept: set[Any] | None = None) -> None:
        super().__init__()
        self.__state = State.PENDING
        self.__outcome = Outcome(State.PENDING)
        self.__ended_by = 0  # the thread that runs the callbacks
        self.__done_callbacks: list[Callable[[Any], object]] = []
        self.__in_vain = in_vain
        self.__kept = set() if kept is None else kept
        self.__process = os.getpid()

    def done(self) -> bool:
        """Whether it has a result or an exception."""
        return self.__state is State.DONE

    def cancelled(self) -> bool:
        """Whether it was cancelled."""
        return self.__state is State.CANCELLED

    def over(self) -> bool:
        """Whether it has an outcome, so that no deadline ends it."""
        return self.__state is not State.PENDING

    def result(self) -> _Result:
        """The result, or raise the exception. None while there is neither, as rclpy's."""
        error = self.exception()
        if error is not None:
            raise error
        return cast(_Result, self.__outcome.result if self.done() else None)

    def exception(self) -> BaseException | None:
        """The exception, or None."""
        self._exception_fetched = True  # otherwise, the finalizer prints it
        return self._exception

    def set_result(self, result: _Result) -> None:
        """End with this result, unless it has ended."""
        self._tf2_end(Outcome(State.DONE, result))

    def set_exception(self, exception: BaseException) -> None:
        """End with this exception, unless it has ended."""
        self._tf2_end(Outcome(State.DONE, None, exception))

    def cancel(self) -> None:
        """
        End the wait; without effect if it has ended.

        The callbacks run in this thread, before it returns, also if they were queued with an outcome already.
        Whatever awaits the future wakes, and gets None, as from rclpy's own. To cancel a coroutine that
        awaits it, cancel its task, see ``__await__``.
        """
        self._tf2_end(Outcome(State.CANCELLED))

    def add_done_callback(self, callback: Callable[[Any], object]) -> None:
        """Add a callback, which keeps the future alive; if it has ended, call it here."""
        with LOCK:
            if not self.__has_ended():
                self.__done_callbacks.append(callback)
                if not only_wakes(callback):
                    self.__kept.add(self)
                # A finalizer may have ended it in between.
                if not self.__has_ended() or callback not in self.__done_callbacks:
                    return
                self.__done_callbacks.remove(callback)
        callback(self)

    def remove_done_callback(self, callback: Callable[[Any], object]) -> bool:
        """Remove a callback; whether it had been added."""
        with LOCK:
            try:
                self.__done_callbacks.remove(callback)
            except ValueError:
                return False
            if all(map(only_wakes, self.__done_callbacks)):
                self.__kept.discard(self)
            return True

    def is_dead(self) -> bool:
        """Whether it is pending in a parent process, so that nothing completes it in this forked child."""
        return is_inherited(self.__process) and not self.__has_ended()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {FORKED if self.is_dead() else self.__state.value}>"

    def __await__(self) -> Generator[Any, Any, _Result]:
        """
        Sleep until it has ended; then return its result, None if it was cancelled, or raise its exception.

        Where the awaiting coroutine is cancelled or closed, Python raises at the ``yield`` of one of the two
        methods below, which removes what would have woken it. The future itself is not cancelled: it waits on
        as long as something refers to it. Usually only the coroutine did, so its waiter ends with it, as the
        engine refers to the future weakly (``_notify``).
        """
        if self.is_dead():
            raise RuntimeError(f"{self!r}: create the future after the fork")
        if not self.__has_ended():
            if (sleeper := _SleepingTask.of_this_thread()) is not None:
                yield from self.__sleep_in(sleeper)
            elif (loop := _running_loop()) is not None:
                yield from self.__sleep_in_loop(loop)
        while not self.__has_ended():
            yield  # it is awaited by a loop of another kind, which polls
        return self.result()

    def __sleep_in(self, sleeper: "_SleepingTask") -> Generator[Any, Any, None]:
        # An executor steps an awaiting task only when it has something else to do, and completing this future
        # gives it nothing to do.
        self.add_done_callback(sleeper)
        try:
            while not self.__has_ended():
                yield
        finally:
            sleeper.awake = True
            self.remove_done_callback(sleeper)

    def __sleep_in_loop(self, loop: "asyncio.AbstractEventLoop") -> Generator[Any, Any, None]:
        # Without this, asyncio would poll.
        sleeper = _SleepingLoop(loop, self)
        try:
            self.__kept.add(sleeper)
            self.add_done_callback(sleeper)
            if self.__in_vain is not None:
                sleeper.expire()
            yield from sleeper.woken
        finally:
            # If the task was cancelled, leave nothing behind.
            self.remove_done_callback(sleeper)
            self.__kept.discard(sleeper)

    def is_in_vain(self) -> bool:
        """Whether a shutdown has ended the wait."""
        return self.__in_vain is not None and self.__in_vain()

    def expire(self) -> None:
        """End the wait after a shutdown: with None, unless a subclass does more. Called in any thread."""
        self._tf2_end(Outcome(State.DONE))

    # For subclasses.

    def _tf2_end(self, outcome: Outcome) -> None:
        """End in this way, unless it has ended, and run the callbacks in this thread."""
        with LOCK:
            if not self.__has_ended():
                self.__outcome = outcome
                self.__show()
        self.__complete()

    def _tf2_end_or_queue(self, outcome: Outcome) -> bool:
        """
        Note how it ends, if it has no outcome, and end it, if that runs no user code.

        :return: whether it is to be queued now.
        """
        with LOCK:
            if self.__state is State.PENDING:
                self.__outcome = outcome
                if not all(map(only_wakes, self.__done_callbacks)):
                    self.__state = State.QUEUED
                    return True
                self.__show()
        self.__complete()
        return False

    def _tf2_is_queued(self) -> bool:
        """Whether it has an outcome that its callbacks wait for."""
        return self.__state is State.QUEUED

    def _tf2_ending(self) -> Ending:
        """What ends it with the outcome that was queued; without effect if it has ended."""
        return Ending(self.__end_queued, self.__drop)

    def __end_queued(self) -> None:
        self._tf2_end(self.__outcome)

    def __drop(self, why: str) -> None:
        """End a queued one without its callbacks, because nothing can run them any more."""
        error = TimeoutException(f"The callbacks of this wait were dropped, because {why}")
        with LOCK:
            if self.__state is State.QUEUED:
                self.__done_callbacks[:] = filter(only_wakes, self.__done_callbacks)
                self.__outcome = Outcome(State.DONE, None, error)
                self.__show()
        self.__complete()

    def __complete(self) -> None:
        # Only the thread that has ended it runs its callbacks; others must not run what is left of them.
        if self.__has_ended() and self.__ended_by == get_ident():
            self._tf2_release()
            self.__kept.discard(self)
            run_done_callbacks(self, self.__done_callbacks)

    def _tf2_release(self) -> None:
        """Let go of what only a wait needs."""

    def __has_ended(self) -> bool:
        return self.__state in (State.DONE, State.CANCELLED)

    def __show(self) -> None:
        # With LOCK held. The state comes last, because a signal handler may cut this short.
        self.__ended_by = get_ident()
        if self.__outcome.error is not None:
            self._exception, self._exception_fetched = self.__outcome.error, False
        self.__state = self.__outcome.state


class _SleepingTask(Waker):
    """An awaiting task of an executor. This does not keep it alive, because it refers to the future."""

    def __init__(self, task: Task) -> None:
        self.awake = False
        self._task = weakref.ref(task)

    @classmethod
    def of_this_thread(cls) -> "_SleepingTask | None":
        """For the task that this thread is stepping, if any."""
        task = running_task()
        return None if task is None else cls(task)

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


class _SleepingLoop(Waker):
    """
    What a task of an asyncio loop awaits: ``woken``, which refers to the task.

    After a shutdown, an executor runs no tasks, but an asyncio loop continues. A signal shuts a context down
    without calling anything, so the thread of the deadlines checks the contexts while a loop awaits.
    """

    def __init__(self, loop: "asyncio.AbstractEventLoop", future: WakingFuture[Any]) -> None:
        self._loop = loop
        self._future = future
        self.woken: asyncio.Future[None] = loop.create_future()

    def __call__(self, _: object) -> None:
        with suppress(RuntimeError):  # the loop is closed, so nothing awaits any more
            self._loop.call_soon_threadsafe(self._end)

    def _end(self) -> None:
        if not self.woken.done():
            self.woken.set_result(None)

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Whether the task is awake, or will never be."""
        return self.woken.done() or self._loop.is_closed()

    def expire(self) -> None:
        """End the future if it waits in vain; otherwise check again after SHUTDOWN_CHECK_NS."""
        if self._future.is_in_vain():
            self._future.expire()
        else:
            deadlines.add(time.monotonic_ns() + SHUTDOWN_CHECK_NS, self)


class TransformFuture(WakingFuture[TransformStamped]):
    """
    The future of a transform that a buffer may not have yet.

    :param lookup: what to wait for. Invalid arguments raise, except an invalid name, which ends the future at
        once.
    :param timeout: an rclpy Duration of steady time, after which the future holds a TimeoutException. None or
        an infinite one: never.

    If the program itself inserts the missing data, the thread that does completes the future, and runs its
    callbacks. If a listener receives it, a future without callbacks is completed at once, in any thread; one
    with callbacks is queued, and completed together with them in the executor that spins the listener's node;
    until then no timeout ends it. The timeout ends a pending one in the executor that has the node of the
    buffer's latest listener; if none does at that moment, in the thread of the deadlines.

    The wait continues as long as something refers to the future. The buffer does if the future has a callback
    or asyncio awaits it.
    """

    def __init__(self, core: BufferCore, lookup: Lookup, timeout: Any = None) -> None:
        self.__shutdown = Shutdown(core)
        super().__init__(self.__shutdown.happened, core._tf2_kept)
        self.__begin_ns = time.monotonic_ns()
        self.__timeout_ns = optional_timeout_ns(timeout)
        self.__core: BufferCore | None = core
        self.__wait: Any = None
        try:
            wait = self.__wait = lookup.wait(core, _notify(weakref.ref(self)))
        except InvalidArgumentException as error:
            self.set_exception(error)
            return
        # From here on, another thread may complete this at any time.
        answer = wait.answer
        if answer is not None:
            self.set_result(answer)
        if self.done():
            self.__wait = self.__core = None
            return
        if self.__timeout_ns is not None:
            deadlines.add(self.__begin_ns + self.__timeout_ns, self)

    def answered(self, answer: Any) -> Ending | None:
        """Complete this; or, if that runs callbacks, return what does."""
        if self.is_dead():
            return None
        self._tf2_end_or_queue(Outcome(State.DONE, answer, None))
        # It may have been queued by a call that a signal handler has cut short.
        return self._tf2_ending() if self._tf2_is_queued() else None

    def expire(self) -> None:
        """
        End at the timeout, or because the context was shut down: with the answer if it has just arrived, or
        with a TimeoutException.
        """
        wait, core = self.__wait, self.__core
        if wait is None or core is None:
            return
        wait.cancel()
        answer, error = wait.answer, None
        if answer is None:
            error = self.__unanswered(wait)
        if self._tf2_end_or_queue(Outcome(State.DONE, answer, error)):
            call_in_executor(queue_of(core), self._tf2_ending())

    def __unanswered(self, wait: Any) -> TimeoutException:
        waited_ns = time.monotonic_ns() - self.__begin_ns
        if self.__timeout_ns is not None:
            waited_ns = min(waited_ns, self.__timeout_ns)
        if self.__shutdown.happened():
            return TimeoutException(errors.shut_down(waited_ns))
        return TimeoutException(errors.timed_out(wait.reason(), waited_ns))

    def _tf2_release(self) -> None:
        wait, self.__wait, self.__core = self.__wait, None, None  # they hold the buffer
        if wait is not None:
            wait.cancel()


def _notify(reference: "weakref.ref[TransformFuture]") -> Callable[[Any], Ending | None]:
    # The engine refers to this as long as the future waits; it must not keep the future alive.
    def notify(answer: Any) -> Ending | None:
        future = reference()
        return None if future is None else future.answered(answer)

    return notify
