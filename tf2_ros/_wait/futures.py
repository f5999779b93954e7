# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Complete futures of transforms, and wake the tasks and asyncio loops that await them."""

import os
import time
import weakref
from collections.abc import Callable, Generator
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from tf2_py import BufferCore, InvalidArgumentException, TimeoutException
from tf2_py._internal import errors
from tf2_ros._arguments import optional_timeout_ns
from tf2_ros._messages import TransformStamped
from tf2_ros._process.background import NEVER_NS, background
from tf2_ros._process.forking import FORKED, is_inherited
from tf2_ros._running_loop import running_loop
from tf2_ros._sources import Shutdown, asks_program
from tf2_ros._wait.asyncio_tasks import LoopWaker
from tf2_ros._wait.pending import PendingFuture, end_referred
from tf2_ros_cython._ros_presence import HAS_ROS

if TYPE_CHECKING or HAS_ROS:
    from rclpy.task import Future

    from tf2_ros._rclpy import HEEDS_FUTURES, running_task, spun_executor
    from tf2_ros._wait.call_queue import end_for as end_for
    from tf2_ros._wait.rclpy_tasks import SpunExecutor, TaskWaker
else:
    from tf2_ros._without_ros import HEEDS_FUTURES, Future, TaskWaker, end_for, running_task

CLOCK_CHECK_NS = 100_000_000  # how often to read a clock that reports no jumps


_Result = TypeVar("_Result")


class WakingFuture(PendingFuture, Future, Generic[_Result]):
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

    if not HEEDS_FUTURES:

        def add_done_callback(self, callback: Callable[[Any], object]) -> None:
            """Add a callback; for that of an executor that spins until this has ended, what ends the spin."""
            executor = spun_executor(callback)
            if executor is None:
                super().add_done_callback(callback)
            elif not any(getattr(waker, "spun", None) is executor for waker in self.wakers):
                super().add_done_callback(SpunExecutor(executor))

    def is_dead(self) -> bool:
        """Whether it is pending in a parent process, so that nothing completes it in this forked child."""
        return is_inherited(self.__process) and not self.has_ended()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {FORKED if self.is_dead() else self.state}>"

    def __await__(self) -> Generator[Any, Any, _Result]:
        """
        Sleep until it has ended; then return its result, None if it was cancelled, or raise its exception.

        Where the awaiting coroutine is cancelled or closed, Python raises at the ``yield``, and what would
        have woken it is removed. As in asyncio, the future is then cancelled, too, unless something else
        awaits it, or it has a callback: otherwise, what refers to the coroutine or to the traceback of the
        cancellation would have it wait on, and report an error that nobody awaits.
        """
        if self.is_dead():
            raise RuntimeError(f"{self!r}: create the future after the fork")
        if not self.has_ended():
            sleeper, is_cancelled = _sleeper(self), True
            try:
                if sleeper is None:  # what drives the coroutine must resume it until it ends
                    while not self.has_ended():
                        yield
                else:
                    self.kept[sleeper] = None
                    self.add_done_callback(sleeper)
                    yield from sleeper.sleep(self)
                is_cancelled = False
            finally:
                if sleeper is not None:
                    sleeper.awake = True
                    self.remove_done_callback(sleeper)
                    self.kept.pop(sleeper, None)
                if is_cancelled and not self.wakers and not self.done_callbacks:
                    self.cancel()
                if self.has_ended():
                    self.exception()  # of a cancelled coroutine, nobody else fetches it
        return self.result()

    def expire(self) -> None:
        """End the wait after a shutdown: with None, unless a subclass does more. Called in any thread."""
        self.end()


def _sleeper(future: WakingFuture[Any]) -> "TaskWaker | LoopWaker | None":
    """What wakes whatever runs in this thread, if that can be woken."""
    loop = running_loop()
    # A callback that an executor runs may run a loop, and a task of a loop may spin an executor.
    task = running_task(is_direct=loop is not None)
    if task is not None:
        return TaskWaker(task)
    return None if loop is None else LoopWaker(loop, future)


class TransformFuture(WakingFuture[TransformStamped]):
    """
    The future of a transform that a buffer may not have yet.

    :param begin: begins to wait, such as ``Lookup.wait``. Invalid arguments raise, except an invalid name,
        which ends the future at once.
    :param timeout: an rclpy Duration of steady time, after which the future holds a TimeoutException. None or
        an infinite one: never.
    :param begin_ns: the steady time from which the timeout counts. None: now.

    If the program itself inserts the missing data, the thread that does completes the future, and runs its
    callbacks. If a listener receives it, a future without callbacks of the program is completed at once, in
    any thread, and wakes what awaits it; one with callbacks is queued, and completed together with them in
    the executor that spins the listener's node; until then no timeout ends it. At the timeout, a pending one
    with callbacks is completed by the executor that has the node of the buffer's latest listener; if none
    does at that moment, by a thread for callbacks. Destroying a node ends no wait.

    The wait continues as long as something refers to the future. The buffer does if the future has a callback
    or is awaited.
    """

    def __init__(
        self,
        core: BufferCore,
        begin: Callable[..., Any],
        timeout: Any = None,
        begin_ns: int | None = None,
    ) -> None:
        self.__shutdown = Shutdown(core)
        super().__init__(self.__shutdown, getattr(core, "_tf2_kept", None))
        self.__core = weakref.ref(core)  # which the wait keeps
        self.__begin_ns = time.monotonic_ns() if begin_ns is None else begin_ns
        timeout_ns = optional_timeout_ns(timeout)
        self.__end_ns = NEVER_NS if timeout_ns is None else self.__begin_ns + timeout_ns
        try:
            # The engine refers to what is notified as long as this waits; it must not keep this alive.
            wait = self.wait = begin(core, partial(end_referred, weakref.ref(self)))
        except InvalidArgumentException as error:
            self.set_exception(error)
            return
        # From here on, another thread may complete this at any time.
        answer = wait.take()
        if answer is not None:
            self.set_result(answer)
        if self.over():
            self.wait = None
        else:
            self.__expire_later(wait)

    def __expire_later(self, wait: Any) -> None:
        # A clock that reports no jumps must be read regularly.
        due_ns = self.__end_ns
        if wait.must_be_tried:
            due_ns = min(due_ns, time.monotonic_ns() + CLOCK_CHECK_NS)
        if due_ns < NEVER_NS:
            background.expire_at(due_ns, self)

    def expire(self) -> None:
        """End with an answer that is there; at the timeout or after a shutdown, with a TimeoutException."""
        wait = self.wait
        if wait is None or self.over():
            return
        if asks_program(self.__core()) and background.run_elsewhere(self.expire):
            return
        reason = wait.reason()  # first: what is inserted in between answers
        answer, error = wait.outcome(), None
        if isinstance(answer, BaseException):  # a limit is of a frame that is not a child, or a clock raises
            answer, error = None, answer
        if answer is None and error is None:
            now_ns, why = time.monotonic_ns(), self.__shutdown.why()
            if now_ns < self.__end_ns and not why:
                self.__expire_later(wait)
                return
            waited_ns = min(now_ns, self.__end_ns) - self.__begin_ns
            text = errors.in_vain(why, waited_ns) if why else errors.timed_out(reason, waited_ns)
            error = TimeoutException(text)
        end_for(self.__core(), self.end_or_queue(answer, error))
