# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Use attributes and frames of rclpy that its documentation does not promise.

The rows of the table say what is assumed, and what users lose where that does not hold: all else goes on
working. The functions ask their row, and log once that they do without; ``tf2_which`` prints the rows that do
not hold. What differs between releases is asked of the object at hand, or once at the import, never of a
version; a row with several answers holds with each. docs/limits.md lists the releases with which all was
tested. ``tf2_py.engine`` has rows of its own, in ``times`` and ``message_layouts``.
"""

import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from inspect import CO_ASYNC_GENERATOR, CO_COROUTINE, CO_GENERATOR, CO_ITERABLE_COROUTINE
from threading import Lock
from types import FrameType, FunctionType, NoneType
from typing import TYPE_CHECKING, Any, TypeGuard
from weakref import ref

import rclpy
import rclpy.node
import rclpy.subscription
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.task import Future, Task

from tf2_py._internal import assumptions
from tf2_ros._running_loop import running_loop
from tf2_ros_cython import _ros_in_use

if TYPE_CHECKING:
    import asyncio

    from rclpy.action.client import ActionClient, ClientGoalHandle

try:
    from rclpy.event_handler import EventHandler, QoSSubscriptionEventType, UnsupportedEventTypeError
except ModuleNotFoundError:  # Humble
    from rclpy.qos_event import QoSEventHandler as EventHandler
    from rclpy.qos_event import QoSSubscriptionEventType, UnsupportedEventTypeError

# What Node and AsyncNode have in common; before rclpy 10, there is only Node.
_BASE_NODE: type = getattr(rclpy.node, "BaseNode", Node)
_BASE_SUBSCRIPTION: type = getattr(rclpy.subscription, "BaseSubscription", Subscription)

# Whether a task that has yielded a future is stepped again when that is done (since rclpy 7.1.9, 9.1.4 and
# 10.0.3), and in the next round if it has yielded None. Before, executors stepped all tasks in each round. Of
# a task that resumes in another way, False is right, too: it is stepped in each round, which costs time.
RESUMES_TASKS = hasattr(Task, "_add_resume_callback")
# Whether an executor that spins until a future is done looks at it whenever it is woken. Humble's looks only
# after a callback or a task, and sleeps on if the future ends in another thread. Assumes that others add a
# callback to the future; an executor that looks in another way gets a task that does nothing.
HEEDS_FUTURES = assumptions.uses(SingleThreadedExecutor, "add_done_callback")

# The files of the executors' own loops.
_LOOP_FILES = frozenset({loop.__code__.co_filename for loop in (rclpy.spin, Executor.spin)})

# The table: what is used, a probe of it, and what users lose without it. Rows without a name are only probed.

_Row, _Attribute, _uses = assumptions.Assumption, assumptions.Attribute, assumptions.uses
_LOCK = type(Lock())


def _async_node_uses(*names: str) -> bool:
    """Whether the methods of ``AsyncNode`` use these; also before rclpy 10, which lacks the class."""
    if _BASE_NODE is Node:
        return True
    # rclpy 10 has it, and exports it from Python 3.12 on.
    from rclpy.experimental.async_node import AsyncNode  # pyright: ignore[reportMissingImports]

    return assumptions.uses(AsyncNode, *names)


IS_SHUTDOWN = _Attribute(
    Executor, "_is_shutdown", bool, "a listener with its own thread takes 1 s longer to end"
)
SIGINT_GUARD = _Attribute(
    Executor,
    "_sigint_gc",
    (GuardCondition, NoneType),
    "a program may crash if Ctrl-C arrives while a listener with its own thread ends",
)
TASKS = _Attribute(
    Executor,
    "_tasks _pending_tasks",  # of Jazzy; of Kilted and others
    (list, dict),
    "an executor that spins a listener wakes ten times a second, not once",
)
TASKS_LOCK = _Attribute(
    Executor, "_tasks_lock", _LOCK, "a signal handler that completes what a task awaits may hang"
)
TASK_LOCK = _Attribute(Task, "_task_lock", _LOCK, "a task that awaits a transform may be resumed twice")
TASK_EXECUTOR = _Attribute(
    Future,
    "_executor",
    (ref, FunctionType, NoneType),
    "a task that awaits a transform is stepped in each round until it ends, which costs up to a core",
)
READY_TO_TAKE = _Attribute(
    EventHandler, "_ready_to_take_data", bool, "lost messages are logged only while the node is spun"
)
CONTEXT_HANDLE = _Attribute(
    Context,
    "handle",
    (rclpy_implementation.Context, NoneType),
    "a forked child may hang when it ends what it has inherited",
)
CLOCK_HANDLE = _Attribute(
    Clock,
    "handle",
    rclpy_implementation.Clock,
    "reading a node's clock takes longer, and recorded times of reception are not simulated ones",
)
_Row(
    "the address, the users and the methods of handles",
    lambda: all(
        hasattr(getattr(rclpy_implementation, name), used)
        for name, names in {
            "Clock": ("pointer", "__enter__", "get_now", "get_ros_time_override_is_enabled"),
            "GuardCondition": ("pointer", "trigger_guard_condition"),
            "Subscription": ("pointer", "__enter__"),
        }.items()
        for used in names
    ),
    "listeners need an executor that spins",
)
OWN_GUARD = _Row(
    "GuardCondition(callback=None, callback_group=None, context=…)",
    lambda: {"callback", "callback_group", "context"} <= {*GuardCondition.__init__.__code__.co_varnames},
    "nodes list a guard condition that is not the program's",
)
EVENT_ARGUMENTS = _Row(
    "the arguments of EventHandler",
    lambda: (
        {"callback_group", "callback", "event_type", "parent_impl"}
        <= {*EventHandler.__init__.__code__.co_varnames}
    ),
    "lost messages are not logged",
)
_Row(
    "the frames between Executor.spin and a waitable",
    lambda: (
        hasattr(Executor, "spin_until_future_complete")
        and {one.__code__.co_filename for one in vars(Executor).values() if isinstance(one, FunctionType)}
        <= _LOOP_FILES
    ),
    "executors wake for each batch of transforms, not once a second",
)
_Row(
    "what executors call of waitables and callback groups",
    lambda: _uses(Executor, "add_to_wait_set", "is_ready", "take_data", "can_execute", "ending_execution"),
    "callbacks are delayed by up to a second, or run beside each other",
)
_Row(
    "how executors resume tasks",
    lambda: (RESUMES_TASKS or _uses(Executor, "executing")) and _is_known_in_step(),
    "a task that awaits a transform is stepped in each round, which costs up to a core",
)
_Row(
    "how executors spin until a future is done",
    lambda: _uses(Executor, "add_done_callback"),
    "such a spin may end late",
)
_Row(
    "Node.destroy_subscription calls Subscription.destroy",
    lambda: _uses(Node, "destroy") and hasattr(Subscription, "destroy"),
    "a listener whose subscription a program destroys goes on receiving",
)
_Row(
    "ClientGoalHandle(client, identifier, response)",
    lambda: _is_goal_accepted(),
    "a BufferClient cannot send goals",
)
TASK_GROUP = _Row(
    "AsyncNode._tg._loop",
    lambda: _async_node_uses("_tg"),
    "what is made in another loop than its node's is not refused",
)
SUBSCRIPTIONS_IN_LOOP = _Row(
    "AsyncNode._entities, _create_subscription_handle and _validate_qos_or_depth_parameter",
    lambda: _async_node_uses("_entities", "_create_subscription_handle", "_validate_qos_or_depth_parameter"),
    "the loop of an AsyncNode takes the messages of listeners",
)


def _release() -> str:
    prefix = _ros_in_use.running_prefix()
    return f"rclpy {(prefix and _ros_in_use.rclpy_version(prefix)) or 'of an unknown version'}"


assumptions.release = _release

# Handles: the objects of the C++ part, each counting its users.


def guard_handle(node: Node) -> Any:
    """Get the handle of a new guard condition, which the node does not list unless that is unavoidable."""
    try:
        made = GuardCondition(callback=None, callback_group=None, context=node.context)
    except TypeError:
        OWN_GUARD.report()
        made = node.create_guard_condition(lambda: None)
    return made.handle


def handle_exists(handle: Any) -> bool:
    """
    Whether a handle was not destroyed.

    A handle is a context manager that counts its users, and raises InvalidHandle when it was destroyed. While
    it has users, it is only marked.
    """
    try:
        with handle:
            return True
    except InvalidHandle:
        return False


def context_was_shut_down(context: Any) -> bool:
    """
    Whether a context was started and has ended since; does not take its lock.

    ``Context.ok()`` takes a lock that may be locked forever in a forked child; it is used only where a
    context has no handle, which is None before the start.
    """
    handle = CONTEXT_HANDLE.of(context, context)
    return handle is not None and not handle.ok()


# Nodes.


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

    A node that runs has a TaskGroup, which knows its loop.

    :raises RuntimeError: no loop runs here, or another one runs the node.
    """
    loop = running_loop()
    kind, name = type(node).__name__, node.get_fully_qualified_name()
    if loop is None:
        raise RuntimeError(
            f"the {kind} [{name}] needs an event loop, but none runs in this thread: call this from a "
            "coroutine, for example inside `async with node`"
        )
    group = getattr(node, "_tg", loop)
    if group is not None and not hasattr(group, "_loop"):
        TASK_GROUP.report()
    if getattr(group, "_loop", loop) is not loop:
        raise RuntimeError(
            f"the {kind} [{name}] runs in another event loop: call this from a coroutine of that loop"
        )
    return loop


# Clocks.

_NOW = Clock.now  # not one that a program has replaced it by


def is_ros_clock(clock: Any) -> bool:
    """Whether a clock may follow /clock."""
    return bool(getattr(clock, "clock_type", None) == ClockType.ROS_TIME)


def clock_handle(clock: Any) -> Any:
    """The handle of a clock that may follow /clock, or None."""
    return CLOCK_HANDLE.of(clock) if is_ros_clock(clock) else None


def clock_in_c(clock: Any) -> tuple[bool, bool, Any] | None:
    """
    How to read one of rclpy's clocks without code in Python: whether it may follow /clock, whether it shows
    steady time, and its handle, None if it is that of the system. None: another class decides what it shows.

    The clock's ``now`` and ``ros_time_is_active`` call these methods of its handle while they have entered
    it. A clock whose handle lacks one of them is read by its ``now()``, as a program's own.
    """
    if getattr(type(clock), "now", None) is not _NOW:
        return None
    if clock.clock_type == ClockType.SYSTEM_TIME:
        return False, False, None
    handle = CLOCK_HANDLE.of(clock)
    needed = ("__enter__", "__exit__", "get_now", "get_ros_time_override_is_enabled")
    if not all(hasattr(handle, name) for name in needed):
        return None
    return is_ros_clock(clock), clock.clock_type == ClockType.STEADY_TIME, handle


# Executors.


def is_shut_down(executor: Executor) -> bool:
    """Whether ``shutdown()`` was called; False if that is not known, and only the context ends a spin."""
    return bool(IS_SHUTDOWN.of(executor, False))


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

    True if that is not known.
    """
    if executor is None:
        return False
    tasks = TASKS.of(executor)
    return tasks is None or len(tasks) > 0


def is_below_own_loop() -> bool:
    """
    Whether one of the own loops of executors (``rclpy.spin``, ``spin``, ``spin_until_future_complete``) runs.

    Otherwise user code called the executor, and continues when ``spin_once()`` returns. Called by a waitable
    in Cython, which has no frame. If not all frames between an executor's loop and the waitable are in these
    files, the result is False, and the executor wakes more often.
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

    ``shutdown()`` begins by setting ``_is_shutdown`` and triggering the guard condition. An executor without
    this attribute is shut down in the ordinary way, without waiting for it.
    """
    if IS_SHUTDOWN.of(executor) is None:
        executor.shutdown(timeout_sec=0)
        return
    executor._is_shutdown = True
    wake(executor)


def shut_down_but_for_signals(executor: Executor) -> object:
    """
    Shut an executor down, but for the guard condition by which rclpy's thread for signals wakes it.

    After a signal, that thread triggers those of all executors, and crashes if one is destroyed meanwhile.
    The caller keeps the returned one, and drops it at another time, which destroys it.

    ``shutdown()`` destroys it unless it is None. If it is not known, nothing is kept.
    """
    woken_by_signals = SIGINT_GUARD.of(executor)
    if woken_by_signals is not None:
        executor._sigint_gc = None
    executor.shutdown()
    return woken_by_signals


def waits_for_sets(executor: object) -> TypeGuard[Executor]:
    """
    Whether an executor waits for sets of entities, and wakes for a guard condition.

    All of rclpy's but its EventsExecutor, and no others, are subclasses of Executor.
    """
    return isinstance(executor, Executor)


def wake(executor: Executor) -> None:
    """
    Wake an executor, unless it was shut down.

    ``wake()`` takes no lock of the executor, and raises one of these errors if another thread is shutting it
    down.
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

    As ``create_subscription`` of an ``AsyncNode``, this makes the handle and checks the profile by methods of
    BaseNode; the node destroys what is in the set ``_entities``. Without these it makes an ordinary one,
    whose messages the loop takes; :func:`is_read_by_loop` tells them apart.
    """
    try:
        profile = node._validate_qos_or_depth_parameter(qos)
        entities, handle = node._entities, node._create_subscription_handle(message_type, topic, profile)
        made: Any = _BASE_SUBSCRIPTION(
            handle, message_type, topic, callback, profile, False, on_destroy=entities.discard
        )
        entities.add(made)
    except (AttributeError, TypeError):  # an error in the arguments is raised again
        made = node.create_subscription(message_type, topic, callback, qos)
        SUBSCRIPTIONS_IN_LOOP.report()
    return made


def is_read_by_loop(node: object, subscription: object) -> bool:
    """Whether a loop takes the messages of a subscription of a node."""
    return runs_in_loop(node) and type(subscription) is not _BASE_SUBSCRIPTION


def on_destroy(subscription: Any, destroy: Callable[[], object]) -> None:
    """
    Have a function called instead of a subscription's ``destroy``.

    Nodes look the method up at the object, so that an attribute of the object replaces it.
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

    ``take_data`` takes an event if ``_ready_to_take_data`` is set, as it is when an executor wakes.
    """
    if READY_TO_TAKE.of(handler) is None:
        return
    handler._ready_to_take_data = True
    with suppress(InvalidHandle):  # it was destroyed
        event: Any = handler.take_data()
        if event is not None and event.total_count_change:
            handler.callback(event)


def watch_losses(node: Any, subscription: Any, callback: Callable[[Any], None]) -> EventHandler | None:
    """
    Have a callback called with each event that says that messages were lost on the way to a subscription.

    A subscription destroys what is in its list ``event_handlers``, as it must before itself, and its node
    then looks for these among its waitables. The subscription of an ``AsyncNode`` has no such list: what
    destroys it must destroy the handler first.

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
    except TypeError:
        EVENT_ARGUMENTS.report()
        return None
    if not runs_in_loop(node):
        subscription.event_handlers.append(handler)
        node.add_waitable(handler)
    return handler


# Tasks, futures and event loops.


_COROUTINES = CO_COROUTINE | CO_GENERATOR | CO_ITERABLE_COROUTINE | CO_ASYNC_GENERATOR
# The code of the methods of Task, one or two of which are on the stack while it steps its coroutine.
_STEPS = {id(code): code for one in vars(Task).values() if (code := getattr(one, "__code__", None))}


def spun_executor(callback: Any) -> Executor | None:
    """
    The executor that spins until a future is done, if it has added this done callback to wake itself.

    That is a function of rclpy.executors whose closure has the executor. Otherwise None: the future does not
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

    Those are functions of ``rclpy.executors``. Others are treated as a program's.
    """
    return isinstance(callback, FunctionType) and callback.__module__ == Executor.__module__


def end_round(executor: Executor) -> None:
    """Give an executor a task that does nothing, after which it looks at the future until which it spins."""
    with suppress(AttributeError, InvalidHandle):  # it is shut down
        executor.create_task(lambda: None)


def running_task(is_direct: bool) -> Task | None:
    """
    The task that an executor is stepping in this thread, for a function that ``__await__`` calls.

    An awaited object cannot ask which task awaits it. A step is a call of a method of Task, so that its frame
    is on the stack and has the task as ``self``. Without such a frame, None: what awaits must be stepped
    until it ends.

    :param is_direct: only if nothing but coroutines is between the two, and no function that runs a loop.
    """
    frame: FrameType | None = sys._getframe(2)
    while frame is not None and id(frame.f_code) not in _STEPS:
        if is_direct and not frame.f_code.co_flags & _COROUTINES:
            return None
        frame = frame.f_back
    task = None if frame is None else frame.f_locals.get("self")
    return task if isinstance(task, Task) else None


def _is_known_in_step() -> bool:
    known = []

    class Awaited:
        def __await__(self) -> Generator[None, None, None]:
            known.append(running_task(is_direct=True))
            yield from ()

    async def wait() -> None:
        await Awaited()

    task = Task(wait)
    task()
    return known == [task]


def task_executor(task: Task) -> Any:
    """The executor of a task; None if it is gone or not known: the task must be stepped until it ends."""
    reference: Any = TASK_EXECUTOR.of(task)
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
    """Whether a thread is stepping a task, so that others skip it; None: it is not known."""
    lock = TASK_LOCK.of(task)
    return None if lock is None else bool(lock.locked())


def has_locked_tasks(executor: Any) -> bool:
    """Whether resuming a task would wait, perhaps for the very call that a signal handler has interrupted."""
    lock = TASKS_LOCK.of(executor)
    return lock is not None and bool(lock.locked())


# Actions.


def handle_of_goal(client: "ActionClient", action_type: Any, identifier: Any) -> "ClientGoalHandle":
    """
    The handle of a goal that was sent, whether or not its acceptance has arrived; it requests the result.

    The handle needs of the server's response only that it says ``accepted``.
    """
    # Most programs need no actions, which take long to import.
    from rclpy.action.client import ClientGoalHandle

    accepted = action_type.Impl.SendGoalService.Response(accepted=True)
    return ClientGoalHandle(client, identifier, accepted)


def _is_goal_accepted() -> bool:
    from tf2_msgs.action import LookupTransform

    client: Any = None
    return bool(handle_of_goal(client, LookupTransform, None).accepted)
