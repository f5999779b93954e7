# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The executors of rclpy that spin until a future has ended, and their tasks that await it."""

import time
import weakref
from collections.abc import Generator
from functools import partial
from typing import Any

from rclpy.executors import Executor
from rclpy.task import Future, Task

from tf2_ros._process.background import background
from tf2_ros._process.threads import call_logged, start
from tf2_ros._rclpy import (
    RESUMES_TASKS,
    end_round,
    has_locked_tasks,
    is_in_step,
    resume,
    task_executor,
)
from tf2_ros._wait.pending import PendingFuture, Waker

STEP_CHECK_NS = 2_000_000  # how often to check whether an executor has left the step of a task


class SpunExecutor(Waker):
    """What ends the spin of an executor until a future, in releases where waking it is not enough."""

    def __init__(self, executor: Executor) -> None:
        self.spun = executor

    def __call__(self, _: object) -> None:
        call = partial(end_round, self.spun)
        if has_locked_tasks(self.spun):
            # A thread waits for the lock, which a signal handler must not.
            start("tf2_ros round", call_logged, call, "At the end of a wait")
        else:
            call()


class TaskWaker(Waker):
    """What wakes a task of an executor, to which it refers weakly, because the task refers to the future."""

    def __init__(self, task: Task) -> None:
        self.awake = False
        self._task = weakref.ref(task)
        self._yielded: weakref.ref[Future] | None = None  # it refers to the task, and the task to it

    def sleep(self, future: PendingFuture) -> Generator[Any, Any, None]:
        """Sleep until the future has ended."""
        while not future.has_ended():
            # Where tasks are resumed, one that yields None is stepped again in the next round, at once.
            yielded: Future | None = Future() if RESUMES_TASKS and self._has_executor() else None
            self._yielded = None if yielded is None else weakref.ref(yielded)
            yield yielded

    def __call__(self, _: object = None) -> None:
        """Have the executor step the task, once none of its threads does."""
        task = None if self.awake else self._task()
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
            background.expire_at(
                time.monotonic_ns() + STEP_CHECK_NS, self
            )  # last: there may be no thread for it

    def _has_executor(self) -> bool:
        task = self._task()
        return task is not None and task_executor(task) is not None

    # The protocol of what is due.

    def over(self) -> bool:
        """Whether the task is awake."""
        return self.awake

    def expire(self) -> None:
        """Try again, because the step may be done."""
        self()
