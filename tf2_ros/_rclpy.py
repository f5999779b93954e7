# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Use attributes and frames of rclpy that its documentation does not promise.

Each function says what it assumes, and what it does if that does not hold. Most tests in tests/ros fail if
that does not hold, and tests/ros/test_rclpy_inside.py tests the rest. What differs between releases is asked
of the object at hand, or once at the import, never of a version; docs/limits.md lists the releases with which
all was tested. ``tf2_py.engine.times`` reads times from their handles.
"""

import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from inspect import CO_ASYNC_GENERATOR, CO_COROUTINE, CO_GENERATOR, CO_ITERABLE_COROUTINE
from types import FrameType, FunctionType
from typing import TYPE_CHECKING, Any, TypeGuard

import rclpy
import rclpy.node
import rclpy.subscription
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.task import Future, Task

from tf2_ros._running_loop import running_loop

if TYPE_CHECKING:
    import asyncio

    from rclpy.action.client import ActionClient, ClientGoalHandle

try:
    from rclpy.event_handler import EventHandler, QoSSubscriptionEventType, UnsupportedEventTypeError
except ModuleNotFoundError:  # Humble
    from rclpy.qos_event import QoSEventHandler as EventHandler
    from rclpy.qos_event import QoSSubscriptionEventType, UnsupportedEventTypeError

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


# Nodes.

# What Node and AsyncNode have in common; before rclpy 10, there is only Node.
_BASE_NODE: type = getattr(rclpy.node, "BaseNode", Node)
_BASE_SUBSCRIPTION: type = getattr(rclpy.subscription, "BaseSubscription", Subscription)


def runs_in_loop(node: object) -> bool:
    """Whether an asyncio loop runs a node, as an ``AsyncNode`` of ``rclpy.experimental``, and no executor."""
    kind = type(node)
    return (
        hasattr(kind, "__aenter__")
        and hasattr(kind, "get_fully_qualified_name")
        and not issubclass(kind, Node)
    )


def is_node(node: object) -> bool:
    """Whether this is a node of rclpy, rather than of a program's own kind or a ``Mock(spec=Node)``."""
    return issubclass(type(node), _BASE_NODE) or runs_in_loop(node)


def loop_of(node: Any) -> "asyncio.AbstractEventLoop":
    """
    The event loop of this thread, which runs the node, or will run it once the program awaits the node.

    Assumes the attribute ``_tg`` of a node that runs already, a TaskGroup with the attribute ``_loop``.
    Without it, nothing is known of another loop.

    :raises RuntimeError: no loop runs here, or another one runs the node.
    """
    loop = running_loop()
    kind, name = type(node).__name__, node.get_fully_qualified_name()
    if loop is None:
        raise RuntimeError(
            f"the {kind} [{name}] needs an event loop, but none runs in this thread: call this from a "
            "coroutine, for example inside `async with node`"
        )
    if getattr(getattr(node, "_tg", None), "_loop", loop) is not loop:
        raise RuntimeError(
            f"the {kind} [{name}] runs in another event loop: call this from a coroutine of that loop"
        )
    return loop


# Clocks.

_NOW = Clock.now  # not one that a program has replaced it by


def is_ros_clock(clock: Any) -> bool:
    """Whether a clock may follow /clock."""
    return bool(getattr(clock, "clock_type", None) == ClockType.ROS_TIME)


def clock_in_c(clock: Any) -> tuple[bool, bool, Any] | None:
    """
    How to read one of rclpy's clocks without code in Python: whether it may follow /clock, whether it shows
    steady time, and its handle, None if it is that of the system. None: another class decides what it shows.

    Assumes that the clock's ``now`` and ``ros_time_is_active`` call these methods of its handle while they
    have entered it. A clock whose handle lacks one of them is read by its ``now()``, as a program's own.
    """
    if getattr(type(clock), "now", None) is not _NOW:
        return None
    if clock.clock_type == ClockType.SYSTEM_TIME:
        return False, False, None
    handle = getattr(clock, "handle", None)
    needed = ("__enter__", "__exit__", "get_now", "get_ros_time_override_is_enabled")
    if not all(hasattr(handle, name) for name in needed):
        return None
    return is_ros_clock(clock), clock.clock_type == ClockType.STEADY_TIME, handle


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
    ``rclpy.spin_once`` and similar functions do at their end. An executor of a program's own that cannot list
    its nodes is believed to have it.
    """
    executor = node.executor
    if executor is None:
        return False
    get_nodes = getattr(executor, "get_nodes", None)
    return get_nodes is None or bool(node in get_nodes())


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


# The files of the executors' own loops.
_LOOP_FILES = frozenset({loop.__code__.co_filename for loop in (rclpy.spin, Executor.spin)})


def is_below_own_loop() -> bool:
    """
    Whether one of the own loops of executors (``rclpy.spin``, ``spin``, ``spin_until_future_complete``) runs.

    Otherwise user code called the executor, and continues when ``spin_once()`` returns. Called by a waitable
    in Cython, which has no frame. Assumes that all frames between an executor's loop and the waitable are in
    these files. Otherwise the result is False, and the executor wakes more often.
    """
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_code.co_filename in _LOOP_FILES:
        if frame.f_code.co_name in ("spin", "spin_until_future_complete"):
            return True
        frame = frame.f_back
    return False


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


def shut_down_but_for_signals(executor: Executor) -> object:
    """
    Shut an executor down, but for the guard condition by which rclpy's thread for signals wakes it.

    After a signal, that thread triggers those of all executors, and crashes if one is destroyed meanwhile.
    The caller keeps the returned one, and drops it at another time, which destroys it.

    Assumes the attribute ``_sigint_gc``, which ``shutdown()`` destroys unless it is None. Without it, nothing
    is kept.
    """
    woken_by_signals = getattr(executor, "_sigint_gc", None)
    if woken_by_signals is not None:
        executor._sigint_gc = None
    executor.shutdown()
    return woken_by_signals


def waits_for_sets(executor: object) -> TypeGuard[Executor]:
    """
    Whether an executor waits for sets of entities, and wakes for a guard condition.

    Assumes that all of rclpy's but its EventsExecutor, and no others, are subclasses of Executor.
    """
    return isinstance(executor, Executor)


def wake(executor: Executor) -> None:
    """
    Wake an executor, unless it was shut down.

    Assumes that ``wake()`` takes no lock of the executor, and raises one of these errors if another thread is
    shutting it down.
    """
    with suppress(AttributeError, InvalidHandle):
        executor.wake()


# Subscriptions.


def is_subscription(made: object) -> bool:
    """Whether a subscription is rclpy's, also of an ``AsyncNode``, and not of a program's own kind."""
    return isinstance(made, _BASE_SUBSCRIPTION)


def subscribe_in_loop(node: Any, message_type: type, topic: str, callback: Any, qos: Any) -> Any:
    """
    Make a subscription of a node that runs in a loop, whose messages the loop leaves alone.

    Assumes what ``create_subscription`` of an ``AsyncNode`` does: that it makes the handle and checks the
    profile by methods of BaseNode, and that the node destroys what is in the set ``_entities``. Without these
    it makes an ordinary one, whose messages the loop takes; :func:`is_read_by_loop` tells them apart.
    """
    try:
        profile = node._validate_qos_or_depth_parameter(qos)
        entities, make = node._entities, node._create_subscription_handle
    except AttributeError:
        return node.create_subscription(message_type, topic, callback, qos)
    made: Any = _BASE_SUBSCRIPTION(
        make(message_type, topic, profile),
        message_type,
        topic,
        callback,
        profile,
        False,
        on_destroy=entities.discard,
    )
    entities.add(made)
    return made


def is_read_by_loop(node: object, subscription: object) -> bool:
    """Whether a loop takes the messages of a subscription of a node."""
    return runs_in_loop(node) and type(subscription) is not _BASE_SUBSCRIPTION


def on_destroy(subscription: Any, destroy: Callable[[], object]) -> None:
    """
    Have a function called instead of a subscription's ``destroy``.

    Assumes that nodes look the method up at the object, so that an attribute of the object replaces it.
    """
    subscription.destroy = destroy


def destroy_subscription(node: Any, subscription: Any) -> None:
    """Destroy a subscription of a node of any kind."""
    if runs_in_loop(node):
        subscription.destroy()
    else:
        node.destroy_subscription(subscription)


def event_handlers(subscription: Any) -> Sequence[EventHandler]:
    """What reports incompatible publishers and lost messages; an ``AsyncNode``'s subscription has none."""
    handlers: Sequence[EventHandler] = getattr(subscription, "event_handlers", ())
    return handlers


def report_event(handler: EventHandler) -> None:
    """
    Call the callback of a handler if its event has happened and no executor has noticed that.

    Assumes that ``take_data`` takes an event if ``_ready_to_take_data`` is set, as it is when an executor
    wakes. Otherwise nothing is logged.
    """
    handler._ready_to_take_data = True
    with suppress(InvalidHandle):  # it was destroyed
        event: Any = handler.take_data()
        if event is not None and event.total_count_change:
            handler.callback(event)


def watch_losses(node: Any, subscription: Any, callback: Callable[[Any], None]) -> EventHandler | None:
    """
    Have a callback called with each event that says that messages were lost on the way to a subscription.

    Assumes that a subscription destroys what is in its list ``event_handlers``, as it must before itself, and
    that its node then looks for these among its waitables. The subscription of an ``AsyncNode`` has no such
    list: what destroys it must destroy the handler first.

    :return: the handler, which :func:`report_event` serves if no executor does; None: the middleware has no
        such event.
    """
    try:
        handler = EventHandler(
            callback_group=ReentrantCallbackGroup() if runs_in_loop(node) else subscription.callback_group,
            callback=callback,
            event_type=QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST,
            parent_impl=subscription.handle,
        )
    except (UnsupportedEventTypeError, AttributeError):
        return None
    if not runs_in_loop(node):
        subscription.event_handlers.append(handler)
        node.add_waitable(handler)
    return handler


# Tasks, futures and event loops.


_COROUTINES = CO_COROUTINE | CO_GENERATOR | CO_ITERABLE_COROUTINE | CO_ASYNC_GENERATOR
# The code of the methods of Task, one or two of which are on the stack while it steps its coroutine.
_STEPS = {id(code): code for one in vars(Task).values() if (code := getattr(one, "__code__", None))}

# Whether a task that has yielded a future is stepped again when that is done (since rclpy 7.1.9, 9.1.4 and
# 10.0.3), and in the next round if it has yielded None. Before, executors stepped all tasks in each round. Of
# a task that resumes in another way, False is right, too: it is stepped in each round, which costs time.
RESUMES_TASKS = hasattr(Task, "_add_resume_callback")
# Whether an executor that spins until a future is done looks at it whenever it is woken. Humble's looks only
# after a callback or a task, and sleeps on if the future ends in another thread. Assumes that others add a
# callback to the future; an executor that looks in another way gets a task that does nothing.
HEEDS_FUTURES = (
    "add_done_callback" in SingleThreadedExecutor.spin_once_until_future_complete.__code__.co_names
)


def spun_executor(callback: Any) -> Executor | None:
    """
    The executor that spins until a future is done, if it has added this done callback to wake itself.

    Assumes a function of rclpy.executors whose closure has the executor. Otherwise None: the future does not
    end the spin in releases without HEEDS_FUTURES.
    """
    if wakes_executor(callback):
        for cell in callback.__closure__ or ():
            if isinstance(cell.cell_contents, Executor):
                return cell.cell_contents
    return None


def wakes_executor(callback: object) -> bool:
    """
    Whether a done callback is one by which an executor wakes itself.

    Assumes that those are functions of ``rclpy.executors``. Otherwise they are treated as a program's.
    """
    return isinstance(callback, FunctionType) and callback.__module__ == Executor.__module__


def end_round(executor: Executor) -> None:
    """Give an executor a task that does nothing, after which it looks at the future until which it spins."""
    with suppress(AttributeError, InvalidHandle):  # it is shut down
        executor.create_task(lambda: None)


def running_task(is_direct: bool) -> Task | None:
    """
    The task that an executor is stepping in this thread, for a function that ``__await__`` calls.

    An awaited object cannot ask which task awaits it. Assumes that a step is a call of a method of Task, so
    that its frame is on the stack and has the task as ``self``. Without such a frame, None: what awaits must
    be stepped until it ends.

    :param is_direct: only if nothing but coroutines is between the two, and no function that runs a loop.
    """
    frame: FrameType | None = sys._getframe(2)
    while frame is not None and id(frame.f_code) not in _STEPS:
        if is_direct and not frame.f_code.co_flags & _COROUTINES:
            return None
        frame = frame.f_back
    task = None if frame is None else frame.f_locals.get("self")
    return task if isinstance(task, Task) else None


def task_executor(task: Task) -> Any:
    """
    The executor of a task, if it still exists.

    Assumes the attribute ``_executor``, a weak reference. Without it, None: the task is not woken, and must
    be stepped until it ends.
    """
    reference: Any = getattr(task, "_executor", None)
    return None if reference is None else reference()


def resume(task: Task, executor: Any, yielded: Future | None) -> None:
    """
    Have an executor step a task that waits.

    Where tasks are not resumed, it is enough to wake the executor. What wakes an EventsExecutor of these
    releases may hang with the GIL; it steps all tasks without a pause anyway.

    :param yielded: the future that the task has yielded. If it is done already, another task steps this one.
    """
    if RESUMES_TASKS:
        with suppress(AttributeError, InvalidHandle):  # it is shut down
            if yielded is None or yielded.done():
                executor.create_task(task)
            else:
                yielded.set_result(None)
    elif waits_for_sets(executor):
        wake(executor)


def is_in_step(task: Task) -> bool | None:
    """
    Whether a thread is stepping a task, so that others skip it; None: it is not known.

    Assumes the attribute ``_task_lock``. Without it, a task may have to be resumed more than once.
    """
    lock = getattr(task, "_task_lock", None)
    return None if lock is None else bool(lock.locked())


def has_locked_tasks(executor: Any) -> bool:
    """
    Whether resuming a task would wait, perhaps for the very call that a signal handler has interrupted.

    Assumes the attribute ``_tasks_lock`` of an Executor. Without it, the answer is False.
    """
    lock = getattr(executor, "_tasks_lock", None)
    return lock is not None and lock.locked()


# Actions.


def handle_of_goal(client: "ActionClient", action_type: Any, identifier: Any) -> "ClientGoalHandle":
    """
    The handle of a goal that was sent, whether or not its acceptance has arrived; it requests the result.

    Assumes that the handle needs of the server's response only that it says ``accepted``.
    """
    # Most programs need no actions, which take long to import.
    from rclpy.action.client import ClientGoalHandle

    accepted = action_type.Impl.SendGoalService.Response(accepted=True)
    return ClientGoalHandle(client, identifier, accepted)
