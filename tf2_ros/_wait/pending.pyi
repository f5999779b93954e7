# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

"""
End what waits once, in one step with its callbacks: a future, a subscription to changes.

This is Cython because no signal handler and no other thread runs between two of its lines that run no code in
Python. So nothing here needs a lock, and nothing has to be repeated after an interrupt. Before Python 3.12,
the collector, and so a finalizer or another thread, may run wherever a container is made, such as a list, a
tuple or a bound method; not where one grows.
"""

import weakref
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import TransformStamped

class Pending:
    """
    What ends once, with its callbacks. The first outcome counts; only `cancel` and `drop` replace a queued
    one.

    It is called to end it with the outcome that is queued. The call returns what has to be called next, after
    other work, or None.
    """

    wait: Any
    kept: dict[Any, None]
    @property
    def call_queue(self) -> Any: ...
    @property
    def state(self) -> str:
        """A word for its state."""
    def over(self) -> bool:
        """Whether it has an outcome, so that no timeout ends it."""
    def has_ended(self) -> bool:
        """Whether it has an outcome that is visible."""
    def end(self, result: Any = None, error: BaseException | str | None = None) -> None:
        """End with this outcome, or with the one that is queued, and run the callbacks in this thread."""
    def end_or_queue(self, result: Any = None, error: BaseException | str | None = None) -> Pending | None:
        """
        End with this outcome, unless it has one; if that runs user code, only note it.

        :return: what has to be called in that case.
        """
    def __call__(self) -> Pending | None:
        """Call self as a function."""
    def cancel(self) -> None:
        """End the wait, or the calls of a subscription; later calls do nothing."""
    def drop(self, why: str) -> None:
        """End a queued one without its callbacks, because nothing can run them any more."""

def call_all(call: Callable[[], Any] | None) -> None:
    """Call this, what that returns, and so on; for a thread that has no other work."""

def end_referred(
    reference: weakref.ref[Pending], answer: Any, error: BaseException | None = None
) -> Pending | None:
    """End what a weak reference refers to, if it exists, with the answer that it waits for, or an error."""

class Waker:
    """The done callback of a future that only wakes whatever awaits it, and may be called several times."""

class PendingFuture(Pending):
    """The part of a future that ends it; see rclpy's Future."""
    @property
    def done_callbacks(self) -> list[Callable[[Any], object]]: ...
    @property
    def wakers(self) -> list[Callable[[Any], object]]: ...
    def done(self) -> bool:
        """Whether it has a result or an exception."""
    def cancelled(self) -> bool:
        """Whether it was cancelled."""
    def result(self) -> Any:
        """The result, or raise the exception. None while there is neither, as rclpy's."""
    def exception(self) -> BaseException | None:
        """The exception, or None."""
    def set_result(self, result: Any) -> None:
        """End with this result, or with the outcome that is queued, see `end`."""
    def set_exception(self, exception: BaseException) -> None:
        """End with this exception, or with the outcome that is queued, see `end`."""
    def add_done_callback(self, callback: Callable[[Any], object]) -> None:
        """Add a callback, which keeps the future alive unless it only wakes; after the end, call it."""
    def remove_done_callback(self, callback: Callable[[Any], object]) -> bool:
        """Remove a callback; whether it had been added."""

class ChangeSubscription(Pending):
    """
    Calls a function with each transform between two frames that differs from the previous one.

    The wait for the next one begins when the function has returned. If it finds a transform at once, the
    thread that ran the function calls it again; an executor does other work in between.

    :param begin: begins to wait, with `notify` and `after` of ``BufferCore._wait``.
    :param kept: see `Pending`.
    """
    def __init__(
        self,
        begin: Callable[..., Any],
        callback: Callable[[TransformStamped], object],
        kept: dict[Any, None],
    ) -> None: ...
