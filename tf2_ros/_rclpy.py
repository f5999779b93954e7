"""
Use attributes and frames of rclpy that its documentation does not promise.

Each function says what it assumes, and what it does if that does not hold. Each assumption has a test in
tests/ros/test_rclpy_inside.py, and was tested with rclpy 7.1 (Jazzy) and 9.1 (Kilted). What an executor's
rounds need in Cython is in ``tf2_ros._wait.rounds``; ``tf2_py.engine.times`` reads times from their handles.
"""

import sys
import weakref
from collections.abc import Callable
from contextlib import ExitStack, suppress
from types import FrameType, FunctionType
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import EventHandler, QoSSubscriptionEventType
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.task import Future, Task
from rclpy.timer import Timer

NEVER_S = 1e9  # the period of a timer that never runs

# What the functions of the C++ part raise. Assumes that it has this name there; otherwise a RuntimeError,
# which rclpy's own error derives from.
RCLError: type[Exception] = getattr(rclpy_implementation, "RCLError", RuntimeError)

# Handles: the objects of the C++ part, each counting its users.


def handle_pointer(handle: Any) -> int:
    """
    The address of a handle's rcl struct.

    Assumes the attribute ``pointer``, an int, which holds while the handle is in use (``enter_handle``).
    Without it an AttributeError is raised.
    """
    pointer: int = handle.pointer
    return pointer


def enter_handle(handle: Any, uses: ExitStack) -> bool:
    """
    Keep a handle from being destroyed while ``uses`` is open; return whether it still existed.

    Assumes that a handle is a context manager that counts its users, and raises InvalidHandle when it was
    destroyed.
    """
    try:
        uses.enter_context(handle)
    except InvalidHandle:
        return False
    return True


def new_wake_handle(context: Any) -> Any:
    """
    The handle of a new guard condition that belongs to no node.

    Assumes that ``GuardCondition`` takes neither callback nor callback group, and that its handle keeps alive
    what it needs.
    """
    return GuardCondition(None, None, context).handle


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


def holding_executor(node: Node) -> Executor | None:
    """
    The executor that has a node now and was not shut down; takes a lock of that executor.

    ``Node.executor`` is not enough: it remains set when the node is removed from the executor, as
    ``rclpy.spin_once`` and similar functions do at their end.
    """
    executor = node.executor
    if executor is None or is_shut_down(executor) or node not in executor.get_nodes():
        return None
    return executor


def is_in_callback(executor: Any) -> bool:
    """
    Whether a thread of an executor is inside a callback, or another task.

    Assumes the attribute ``_tasks``, of Jazzy, or ``_pending_tasks``, of Kilted: all tasks that are not done,
    one for each callback that runs. Without either, as in rclpy's ``EventsExecutor``, the answer is True.
    """
    tasks = _tasks_of(executor)
    return tasks is None or any(is_in_step(task) for task in tasks)


def has_tasks(executor: Executor | None) -> bool:
    """
    Whether an executor has tasks that are not done, some of which may poll in each of its rounds.

    Assumes the attribute ``_tasks``, of Jazzy, or ``_pending_tasks``, of Kilted. Without either, the answer
    is True.
    """
    if executor is None:
        return False
    tasks = _tasks_of(executor)
    return tasks is None or len(tasks) > 0


def _tasks_of(executor: Any) -> list[Any] | None:
    tasks = getattr(executor, "_tasks", getattr(executor, "_pending_tasks", None))
    # Jazzy has tuples that begin with the task.
    return None if tasks is None else [one[0] if isinstance(one, tuple) else one for one in list(tasks)]


def executor_wake_handle(executor: Executor) -> Any:
    """
    The handle of the guard condition that wakes an executor.

    Assumes the attribute ``_guard``. Without it, None.
    """
    return getattr(getattr(executor, "_guard", None), "handle", None)


def mark_shut_down(executor: Executor, wake_handle: Any) -> None:
    """
    Let an executor end its spin, without destroying what another thread is using, and without its locks.

    Assumes that ``shutdown()`` begins by setting ``_is_shutdown`` and triggering the guard condition. An
    executor without these is shut down in the ordinary way, without waiting for it.

    :param wake_handle: of :func:`executor_wake_handle`, taken while the executor was new.
    """
    if wake_handle is None or not hasattr(executor, "_is_shutdown"):
        executor.shutdown(timeout_sec=0)
        return
    executor._is_shutdown = True
    trigger(wake_handle)


def trigger(wake_handle: Any) -> None:
    """Wake the executor that waits for a guard condition, given its handle; without one, do nothing."""
    if wake_handle is not None:
        with suppress(InvalidHandle), wake_handle:  # it was destroyed: the spin has ended
            wake_handle.trigger_guard_condition()


# Subscriptions.


def hide_from_executors(subscription: Subscription, is_hidden: bool = True) -> None:
    """
    Keep executors from waiting for a subscription and its events, or no longer.

    Assumes that they skip an entity whose ``_executor_event`` is set, as if an executor were about to take
    from it. An executor that ignores it takes messages, too, and inserts them by the subscription's callback.
    """
    events: Any = subscription.event_handlers  # rclpy declares them as one
    for entity in (subscription, *events):
        entity._executor_event = is_hidden


def report_incompatible_qos(handler: EventHandler) -> None:
    """
    Log that a publisher's QoS does not fit, if that has happened, for a handler that no executor has.

    Assumes that ``take_data`` takes an event if ``_ready_to_take_data`` is set, as it is when an executor
    wakes. Otherwise nothing is logged.
    """
    if handler.event_type != QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS:
        return
    handler._ready_to_take_data = True
    with suppress(InvalidHandle):  # it was destroyed
        event: Any = handler.take_data()
        if event is not None and event.total_count_change:
            handler.callback(event)


# Nodes and actions.


def has_callback_groups(node: Any) -> bool:
    """
    Whether the subscriptions of a node take a callback group.

    Assumes of the AsyncNode of rclpy 10, which is entered by ``async with``: they take neither a group nor
    QoS overrides, and end by ``destroy``.
    """
    return not hasattr(type(node), "__aenter__")


def parameter_overrides(node: Any) -> dict[str, Any]:
    """
    The parameters that a node was started with.

    Assumes the attribute ``_parameter_overrides``, a dict. Without it there are none.
    """
    given = getattr(node, "_parameter_overrides", None)
    return given if isinstance(given, dict) else {}


class NodeEnd:
    """
    Calls a function when a node is destroyed, which destroys neither action servers nor action clients.

    Assumes that ``destroy_node()`` calls ``destroy()`` of each of the node's timers: this has one that never
    runs. Executors skip it where they skip an entity whose ``_executor_event`` is set. Where a node makes
    timers of another class, or is not rclpy's, nothing is called; nor after the shutdown of its context,
    which destroys nodes in Kilted.

    :param call: kept alive by the node until :meth:`forget`.
    """

    def __init__(self, node: object, call: Callable[[], None]) -> None:
        self._node: weakref.ref[Node] | None = None
        self._call = _nothing
        if not isinstance(node, Node):
            return
        timer: Any = node.create_timer(NEVER_S, _nothing, clock=Clock(clock_type=ClockType.STEADY_TIME))
        timer.cancel()
        if type(timer) is Timer:
            self._node, self._timer, self._call = weakref.ref(node), timer, call
            timer._executor_event, timer.destroy = True, self._destroyed

    def forget(self) -> None:
        """Call nothing; without effect the second time."""
        node = None if self._node is None else self._node()
        if node is not None:
            self._call = _nothing
            with suppress(InvalidHandle):  # its executor is being shut down
                node.destroy_timer(self._timer)
        self._node = None

    def _destroyed(self) -> None:
        call, self._call = self._call, _nothing
        node = None if self._node is None else self._node()
        if node is not None and not context_was_shut_down(node.context):
            call()
        Timer.destroy(self._timer)


def _nothing() -> None:
    pass


# Tasks and futures.

_STEP_CODE = getattr(Task.__dict__.get("__call__"), "__code__", None)


def running_task() -> Task | None:
    """
    The task that an executor is stepping in this thread.

    An awaited object cannot ask which task awaits it. Assumes that a step is a call of ``Task.__call__``, so
    that its frame is on the stack and has the task as ``self``. Without such a frame, None: the executor then
    steps the task only in its own rounds.
    """
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_code is not _STEP_CODE:
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


def only_wakes_executor(callback: Any) -> bool:
    """
    Whether an executor wakes itself by this done callback of a future, which is not code of a user then.

    Assumes that such callbacks are functions of ``rclpy.executors``. Otherwise they keep a future alive, as
    callbacks of a user do.
    """
    return isinstance(callback, FunctionType) and callback.__module__ == "rclpy.executors"


class HookedFuture(Future):
    """
    A future with a say in when and how its done callbacks are called.

    Assumes that ``Future`` keeps its callbacks in the list ``_callbacks`` and its executor in the weak
    reference ``_executor``, both under ``_lock``, and that the methods that set the outcome call the
    callbacks in ``_schedule_or_invoke_done_callbacks()``. If it has no such attributes, it calls them in its
    own way.

    :param lock: used instead of rclpy's own, which a fork may find held.
    """

    _callbacks: list[Callable[[Any], None]]

    def __init__(self, lock: Any) -> None:
        super().__init__()
        self._lock = lock

    def set_result(self, result: Any) -> None:
        """Set the result, and call the callbacks."""
        super().set_result(result)
        self._tf2_completed()

    def set_exception(self, exception: BaseException) -> None:
        """Set the exception, and call the callbacks."""
        super().set_exception(exception)
        self._tf2_completed()

    def cancel(self) -> None:
        """Cancel, if it is pending, and call the callbacks."""
        super().cancel()
        self._tf2_completed()

    def _schedule_or_invoke_done_callbacks(self) -> None:
        """Leave the callbacks to :meth:`_tf2_completed`."""

    def _tf2_completed(self) -> None:
        """Call the callbacks that were not called yet, because the outcome is set."""
        reference: Any = getattr(self, "_executor", None)
        if reference is None or not hasattr(self, "_callbacks"):
            super()._schedule_or_invoke_done_callbacks()
        else:
            self._tf2_run_callbacks(reference(), self._callbacks)

    def _tf2_run_callbacks(self, executor: Executor | None, callbacks: list[Callable[[Any], None]]) -> None:
        """Remove the callbacks from the list, and call each of them."""
        raise NotImplementedError
