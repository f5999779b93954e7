"""
Use attributes and frames of rclpy that its documentation does not promise.

Each function says what it assumes, and what it does if that does not hold. Most tests in tests/ros fail if
that does not hold, and tests/ros/test_rclpy_inside.py tests the rest. All was tested with rclpy 7.1 (Jazzy)
and 9.1 (Kilted). What an executor's rounds need in Cython is in ``tf2_ros._wait.rounds``;
``tf2_py.engine.times`` reads times from their handles.
"""

import sys
from contextlib import suppress
from inspect import CO_ASYNC_GENERATOR, CO_COROUTINE, CO_GENERATOR, CO_ITERABLE_COROUTINE
from types import FrameType
from typing import Any

from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.task import Task

# Handles: the objects of the C++ part, each counting its users.


def handle_exists(handle: Any) -> bool:
    """
    Whether a handle was not destroyed.

    Assumes that a handle is a context manager that counts its users, and raises InvalidHandle when it was
    destroyed. While it has users, it is only marked.
    """
    try:
        with handle:
            return True
    except InvalidHandle:
        return False


def context_was_shut_down(context: Any) -> bool:
    """
    Whether a context was started and has ended since; does not take its lock.

    Assumes the attribute ``handle``, which is None before the start, and its method ``ok``. ``Context.ok()``
    takes a lock that may be locked forever in a forked child. Without a handle it is used nevertheless.
    """
    handle = getattr(context, "handle", context)
    return handle is not None and not handle.ok()


# Executors.


def is_shut_down(executor: Executor) -> bool:
    """
    Whether ``shutdown()`` was called.

    Assumes the attribute ``_is_shutdown``. Without it, the answer is False: only the context ends a spin.
    """
    return bool(getattr(executor, "_is_shutdown", False))


def is_in_executor(node: Node) -> bool:
    """
    Whether an executor has a node now; takes a lock of that executor.

    ``Node.executor`` is not enough: it remains set when the node is removed from the executor, as
    ``rclpy.spin_once`` and similar functions do at their end.
    """
    executor = node.executor
    return executor is not None and node in executor.get_nodes()


def has_tasks(executor: Executor | None) -> bool:
    """
    Whether an executor has tasks that are not done, some of which may poll in each of its rounds.

    Assumes the attribute ``_tasks``, of Jazzy, or ``_pending_tasks``, of Kilted. Without either, the answer
    is True.
    """
    if executor is None:
        return False
    tasks = getattr(executor, "_tasks", getattr(executor, "_pending_tasks", None))
    return tasks is None or len(tasks) > 0


def mark_shut_down(executor: Executor) -> None:
    """
    Let an executor end its spin, without destroying what another thread is using, and without its locks.

    Assumes that ``shutdown()`` begins by setting ``_is_shutdown`` and triggering the guard condition. An
    executor without this attribute is shut down in the ordinary way, without waiting for it.
    """
    if not hasattr(executor, "_is_shutdown"):
        executor.shutdown(timeout_sec=0)
        return
    executor._is_shutdown = True
    wake(executor)


def wake(executor: Executor) -> None:
    """
    Wake an executor, unless it was shut down.

    Assumes that ``wake()`` takes no lock of the executor, and raises one of these errors if another thread is
    shutting it down.
    """
    with suppress(AttributeError, InvalidHandle):
        executor.wake()


# Subscriptions.


def report_event(handler: EventHandler) -> None:
    """
    Log that a publisher does not fit, if that has happened, for a handler that no executor has.

    Assumes that ``take_data`` takes an event if ``_ready_to_take_data`` is set, as it is when an executor
    wakes. Otherwise nothing is logged.
    """
    handler._ready_to_take_data = True
    with suppress(InvalidHandle):  # it was destroyed
        event: Any = handler.take_data()
        if event is not None and event.total_count_change:
            handler.callback(event)


# Tasks and futures.

_COROUTINES = CO_COROUTINE | CO_GENERATOR | CO_ITERABLE_COROUTINE | CO_ASYNC_GENERATOR
_STEP_CODE = getattr(Task.__dict__.get("__call__"), "__code__", None)


def running_task(is_direct: bool) -> Task | None:
    """
    The task that an executor is stepping in this thread, for a function that ``__await__`` calls.

    An awaited object cannot ask which task awaits it. Assumes that a step is a call of ``Task.__call__``, so
    that its frame is on the stack and has the task as ``self``. Without such a frame, None: the executor then
    steps the task only in its own rounds.

    :param is_direct: only if nothing but coroutines is between the two, and no function that runs a loop.
    """
    frame: FrameType | None = sys._getframe(2)
    while frame is not None and frame.f_code is not _STEP_CODE:
        if is_direct and not frame.f_code.co_flags & _COROUTINES:
            return None
        frame = frame.f_back
    task = None if frame is None else frame.f_locals.get("self")
    return task if isinstance(task, Task) else None


def task_executor(task: Task) -> Executor | None:
    """
    The executor of a task, if it still exists.

    Assumes the attribute ``_executor``, a weak reference. Without it, None: the task is not woken.
    """
    reference: Any = getattr(task, "_executor", None)
    executor: Executor | None = None if reference is None else reference()
    return executor


def is_in_step(task: Task) -> bool:
    """
    Whether a thread is stepping a task, so that other threads skip it.

    Assumes the attribute ``_task_lock``. Without it the answer is True: the caller checks again later.
    """
    lock = getattr(task, "_task_lock", None)
    return lock is None or lock.locked()
