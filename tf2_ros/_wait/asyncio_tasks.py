# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Wake tasks of asyncio, and end what they await after a shutdown."""

import os
import time
import weakref
from collections.abc import Callable, Generator
from functools import partial
from typing import TYPE_CHECKING, Any

from tf2_ros._live_objects import LiveObjects
from tf2_ros._process.background import background
from tf2_ros._wait.pending import Waker

if TYPE_CHECKING:
    import asyncio

SHUTDOWN_CHECK_NS = 100_000_000  # how often to check the contexts of what asyncio awaits


class LoopWaker(Waker):
    """
    What wakes a task of an asyncio loop, which otherwise would poll. It awaits ``_woken``.

    :param future: the WakingFuture that the task awaits.
    """

    def __init__(self, loop: "asyncio.AbstractEventLoop", future: Any) -> None:
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
    without calling anything, so the background thread checks the contexts while a loop awaits.
    """

    _known: "dict[tuple[asyncio.AbstractEventLoop, Callable[[], bool]], weakref.ref[_ShutdownCheck]]" = {}

    def __init__(self, loop: "asyncio.AbstractEventLoop", is_in_vain: Callable[[], bool]) -> None:
        self._loop, self._is_in_vain = loop, is_in_vain
        self.sleepers: LiveObjects[LoopWaker] = LiveObjects()
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
        background.expire_at(time.monotonic_ns() + SHUTDOWN_CHECK_NS, self)

    # A Timer of the background thread.

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


# A forked child has neither the loops nor the background thread.
os.register_at_fork(after_in_child=_ShutdownCheck._known.clear)
