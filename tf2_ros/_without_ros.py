# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What replaces the parts of ROS that a buffer uses, by the same names, if there is no ROS."""

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import NoReturn

from tf2_ros._process.threads import callbacks
from tf2_ros._wait.pending import call_all
from tf2_ros_cython._ros_presence import absence

HEEDS_FUTURES = True


class Future:
    """Adds nothing to a ``PendingFuture``."""


class InvalidHandle(Exception):
    """Never raised."""


class Clock:
    """The system's clock."""

    def now(self) -> int:
        """Return the time in nanoseconds since 1970."""
        return time.time_ns()


def clock_in_c(clock: object) -> tuple[bool, bool, None] | None:
    """Say that the system's clock is neither simulated nor steady; return None for another one."""
    return (False, False, None) if type(clock) is Clock else None


class TaskWaker:
    """Never made."""


def running_task(is_direct: bool) -> None:
    """Return None, because there are no tasks but those of asyncio."""


def end_for(buffer: object, pending: Callable[[], object] | None) -> None:
    """Have another thread end something, because there are no executors."""
    if pending is not None:
        callbacks.put(partial(call_all, pending))


def names_that_need_ros(module: str, *others: str) -> Callable[[str], NoReturn]:
    """
    Make the ``__getattr__`` of a module, which says of the names that it lacks what to install.

    :param others: names that need ROS, but are not in the module's ``__all__``.
    """

    def __getattr__(name: str) -> NoReturn:
        if name in (*sys.modules[module].__all__, *others):
            raise absence(f"{module}.{name}")
        raise AttributeError(f"module {module!r} has no attribute {name!r}")

    return __getattr__
