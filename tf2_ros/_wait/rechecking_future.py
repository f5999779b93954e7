"""Owns the future of what a program's own methods answer: they are called again after every insert."""

import threading
import time
from collections.abc import Callable
from typing import Any

from tf2_py import BufferCore
from tf2_ros._forking import register_for_fork
from tf2_ros._messages import TransformStamped
from tf2_ros._receive.callback_thread import callback_thread
from tf2_ros._receive.receiver_thread import hand_over
from tf2_ros._times import optional_timeout_ns
from tf2_ros._wait.contexts import Shutdown, unanswered
from tf2_ros._wait.deadlines import deadlines
from tf2_ros._wait.waking_future import WakingFuture

__all__ = ["RecheckingFuture"]


class RecheckingFuture(WakingFuture[TransformStamped]):
    """
    The future of what a method answers, called again after every insert.

    :param can: whether it would answer, and if not, why: the tuple of ``can_transform_core``.
    :param look_up: returns the answer.
    :param timeout: as of :class:`tf2_ros._wait.transform_future.TransformFuture`.
    """

    def __init__(
        self,
        core: BufferCore,
        can: Callable[[], tuple[Any, str]],
        look_up: Callable[[], Any],
        timeout: Any = None,
    ) -> None:
        self.__shutdown = Shutdown(core)
        super().__init__(self.__shutdown.happened)
        self.__core: BufferCore | None = core
        self.__can: Callable[[], tuple[Any, str]] | None = can
        self.__look_up: Callable[[], Any] | None = look_up
        self.__begin_ns = time.monotonic_ns()
        self.__timeout_ns = optional_timeout_ns(timeout)
        self.after_fork()
        register_for_fork(self)
        core._new_data_callbacks.append(self.__check)
        self.__check()
        if self.__timeout_ns is not None and not self.over():
            deadlines.add(self.__begin_ns + self.__timeout_ns, self)

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
