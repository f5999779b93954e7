"""Owns waiting on a buffer whose methods a program has replaced: the waits call these, as in tf2."""

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import TransformStamped

from tf2_py import BufferCore, TransformException
from tf2_py.typing import TimeLike, TimeoutLike
from tf2_ros._forking import register_for_fork
from tf2_ros._receive.callback_thread import callback_thread
from tf2_ros._receive.receiver_thread import hand_over
from tf2_ros._times import timeout_ns
from tf2_ros._wait.blocking import BlockingWait
from tf2_ros._wait.contexts import Shutdown, unanswered
from tf2_ros._wait.deadlines import deadlines
from tf2_ros._wait.waking_future import WakingFuture
from tf2_ros.buffer_interface import NO_TIMEOUT

__all__ = [
    "RecheckingFuture",
    "lookup_transform_via_can",
    "lookup_transform_full_via_can",
]


def lookup_transform_via_can(
    self: Any, target_frame: str, source_frame: str, time: TimeLike, timeout: TimeoutLike = NO_TIMEOUT
) -> TransformStamped:
    """The ``lookup_transform`` of a buffer that has a ``can_transform*`` of its own."""
    wait = _wait(self, timeout)
    self.can_transform(target_frame, source_frame, time, timeout)
    return _answer(wait, partial(self.lookup_transform_core, target_frame, source_frame, time))


def lookup_transform_full_via_can(
    self: Any,
    target_frame: str,
    target_time: TimeLike,
    source_frame: str,
    source_time: TimeLike,
    fixed_frame: str,
    timeout: TimeoutLike = NO_TIMEOUT,
) -> TransformStamped:
    """The same for ``lookup_transform_full``."""
    wait = _wait(self, timeout)
    self.can_transform_full(target_frame, target_time, source_frame, source_time, fixed_frame, timeout)
    arguments = (target_frame, target_time, source_frame, source_time, fixed_frame)
    return _answer(wait, partial(self.lookup_transform_full_core, *arguments))


def _wait(buffer: Any, timeout: Any) -> BlockingWait:
    try:
        nanoseconds = timeout_ns(timeout)
    except (TypeError, ValueError):
        nanoseconds = 0  # a program's own `can_transform` may accept what is no timeout elsewhere
    return BlockingWait(buffer, nanoseconds)


def _answer(wait: BlockingWait, look_up: Callable[[], TransformStamped]) -> TransformStamped:
    try:
        return look_up()
    except TransformException as error:
        told = wait.error(error)
        if told is error:
            raise
        raise told from None


class RecheckingFuture(WakingFuture[TransformStamped]):
    """
    The future of what a method answers, called again after every insert.

    :param can: whether it would answer, and if not, why: the tuple of ``can_transform_core``.
    :param look_up: returns the answer.
    :param timeout_ns: nanoseconds of steady time, after which the future holds a TimeoutException. None:
        never.
    """

    def __init__(
        self,
        core: BufferCore,
        can: Callable[[], tuple[Any, str]],
        look_up: Callable[[], Any],
        timeout_ns: int | None,
    ) -> None:
        self.__shutdown = Shutdown(core)
        super().__init__(self.__shutdown.happened)
        self.__core: BufferCore | None = core
        self.__can: Callable[[], tuple[Any, str]] | None = can
        self.__look_up: Callable[[], Any] | None = look_up
        self.__begin_ns = time.monotonic_ns()
        self.__timeout_ns = timeout_ns
        self.after_fork()
        register_for_fork(self)
        core._new_data_callbacks.append(self.__check)
        self.__check()
        if timeout_ns is not None and not self.over():
            deadlines.add(self.__begin_ns + timeout_ns, self)

    def after_fork(self) -> None:
        """Make the lock anew: in a forked child it must be free."""
        self.__checking = threading.RLock()

    def over(self) -> bool:
        """Whether the wait has ended, in whatever way."""
        return bool(self.done() or self.cancelled())

    def expire(self) -> None:
        """The timeout is over."""
        core = self.__core
        if core is not None:
            hand_over(core, self.__end_unanswered)

    def end_with_context(self) -> None:
        """The context was shut down."""
        # No executor would do it now.
        callback_thread.put(self.__end_unanswered)

    def __end_unanswered(self) -> None:
        with self.__checking:
            self.__check()
            can = self.__can
            if can is not None:
                error = unanswered(self.__shutdown, self.__begin_ns, self.__timeout_ns, lambda: can()[1])
                self.set_exception(error)

    def cancel(self) -> None:
        """End the wait."""
        self.__end()
        super().cancel()

    def set_result(self, result: Any) -> None:
        """End the wait with this result."""
        self.__end()
        super().set_result(result)

    def set_exception(self, exception: BaseException) -> None:
        """End the wait with this exception."""
        self.__end()
        super().set_exception(exception)

    def __end(self) -> None:
        # All three refer to the buffer.
        core, self.__core, self.__can, self.__look_up = self.__core, None, None, None
        if core is not None and self.__check in core._new_data_callbacks:
            core._new_data_callbacks.remove(self.__check)

    def __check(self) -> None:
        with self.__checking:
            can, look_up = self.__can, self.__look_up
            if can is None or look_up is None:
                return
            try:
                if not can()[0]:
                    return
                answer = look_up()
            except BaseException as error:
                self.set_exception(error)
                return
            self.set_result(answer)
