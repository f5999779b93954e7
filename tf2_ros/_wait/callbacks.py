"""Run a program's callbacks in the executor or the event loop that runs their node, one at a time."""

import os
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.waitable import Waitable

from tf2_py._internal import log
from tf2_ros._forking import LOCK, LiveObjects, is_inherited
from tf2_ros._nodes import WaitContexts, keep_in_children, node_has_ended
from tf2_ros._rclpy import context_was_shut_down, is_in_executor, loop_of, runs_in_loop
from tf2_ros._receive.inboxes import check_regularly
from tf2_ros._wait.endings import Ending, call_logged
from tf2_ros._wait.rounds import Calls, ExecutorRounds

Call = Callable[[], object]

WARN_S = 10.0  # how long calls wait for an executor before a warning says so
# How often rclpy's EventsExecutor looks for calls. It waits for no guard condition, and a thread that wakes
# it in any other way hangs in some releases, with the GIL.
POLL_S = 0.02


class NodeQueue:
    """
    Runs callbacks of a program one at a time, in the order of :meth:`put`, in what runs a node.

    While nothing runs the node they wait, as its subscriptions do. After WARN_S, a warning says so. When the
    node has ended, which is noticed within two seconds, they are dropped. A subclass says what runs the node.

    :param node: keeps this object alive.
    """

    calls: deque[Call]
    waits_from_ns: int
    in_sets: bool  # nothing else has the arrivals of the node's subscriptions reported
    run: Callable[[int], None]
    drop: Callable[[str], None]
    wake: Callable[[], None]  # has the calls made soon; from any thread

    def __init__(self, node: Any) -> None:
        keep_in_children(node)
        self.node: weakref.ref[Any] = weakref.ref(node)
        self._name = node.get_fully_qualified_name()
        self._context = node.context
        self._why_closed = ""
        self._has_warned = False
        self._process = os.getpid()

    def put(self, call: Call) -> None:
        """Add a call, from any thread, signal handler or finalizer; after the end of the node, drop it."""
        if is_inherited(self._process):
            return  # the node is the parent's
        if not self.calls:
            self.waits_from_ns = time.monotonic_ns()
        self.calls.append(call)
        if self._why_closed:
            self.drop(self._why_closed)
        else:
            self.wake()

    def _tf2_check(self) -> None:
        """Drop the calls if the node has ended; warn if they have waited for long."""
        node = self.node()
        if node is None:
            self.close(f"the node [{self._name}] was collected")
        if self._why_closed or node is None:
            return
        if node_has_ended(node):
            if context_was_shut_down(self._context):
                self.close(f"the context of the node [{self._name}] was shut down")
                # After a signal, rclpy first wakes its executors and then shuts the contexts down. One that
                # goes to sleep in between would sleep until a message wakes it.
                self.wake()
            else:
                self.close(f"the node [{self._name}] was destroyed")
        elif self.calls and not self._has_warned and time.monotonic_ns() - self.waits_from_ns > WARN_S * 1e9:
            self._has_warned = True
            log.logger("tf2_ros").warning(
                f"Callbacks of tf2 have been waiting for {WARN_S:g} s: {self._why_late()}"
            )

    def close(self, why: str) -> None:
        """Drop the calls, now and from now on, and leave the node; may be called again."""
        self._why_closed = self._why_closed or why
        self._leave()
        self.drop(self._why_closed)

    def __del__(self) -> None:
        """Drop the calls, because the node was not destroyed, but collected."""
        if self.calls and not is_inherited(self._process):
            self.close(f"the node [{self._name}] was collected")

    def has_ended(self) -> bool:
        """Whether calls are dropped, now or soon."""
        node = self.node()
        return node is None or bool(self._why_closed) or is_inherited(self._process) or node_has_ended(node)

    # For subclasses.

    def is_served(self) -> bool:
        """Whether something runs the node now."""
        raise NotImplementedError

    def _leave(self) -> None:
        """Undo what has made the node know this, if anything."""

    def _why_late(self) -> str:
        raise NotImplementedError


class CallbackQueue(NodeQueue, ExecutorRounds, Waitable):
    """
    Runs callbacks in the executor that spins a node.

    :param group: the callback group that they run in; None: a separate one.
    """

    def __init__(self, node: Node, group: CallbackGroup | None = None) -> None:
        NodeQueue.__init__(self, node)
        Waitable.__init__(self, MutuallyExclusiveCallbackGroup() if group is None else group)
        self.receivers: LiveObjects[Any] = LiveObjects()  # of the node's listeners
        self.set_up(GuardCondition(None, None, node.context).handle)  # of no node
        node.add_waitable(self)
        check_regularly(self)

    def is_served(self) -> bool:
        node = self.node()
        return node is not None and is_in_executor(node)

    def _leave(self) -> None:
        node = self.node()
        if node is not None and self in node.waitables:
            node.remove_waitable(self)

    def _why_late(self) -> str:
        return (
            f"nobody spins the node [{self._name}], or one of its callbacks does not return. Spin it in a "
            "thread, for example with rclpy.spin(node)."
        )

    def executor(self) -> Any:
        """The executor that has the node, or had it last; None if there was none, or if it is gone."""
        return getattr(self.node(), "executor", None)

    def leave_sets(self) -> None:
        """Have a timer look for calls, in any executor, because an ``EventsExecutor`` has taken the node."""
        for receiver in self.receivers:
            receiver.leave_sets()
        node, clock = self.node(), Clock(clock_type=ClockType.STEADY_TIME)
        if node is not None:
            node.create_timer(POLL_S, lambda: self.run(len(self.calls)), self.callback_group, clock=clock)

    async def execute(self, taken_data: int) -> None:
        """Run this many calls, in an executor."""
        self.run(taken_data)


class LoopQueue(NodeQueue, Calls):
    """Runs callbacks in the asyncio loop that runs a node, which is the one in which this is made."""

    in_sets = True

    def __init__(self, node: Any) -> None:
        NodeQueue.__init__(self, node)
        self._loop = loop_of(node)
        check_regularly(self)

    def wake(self) -> None:
        try:
            self._loop.call_soon_threadsafe(self._run)
        except RuntimeError:  # the loop is closed
            self.drop(f"the event loop of the node [{self._name}] was closed")

    def is_served(self) -> bool:
        return bool(self._loop.is_running())

    def _run(self) -> None:
        if self.has_ended():
            self.drop(self._why_closed or f"the node [{self._name}] was destroyed")
        else:
            self.run(len(self.calls))

    def _why_late(self) -> str:
        return f"the event loop of the node [{self._name}] does not run, or something in it does not return."


def callback_queue(node: Any) -> NodeQueue:
    """
    Get the queue of a node.

    :raises RuntimeError: an event loop runs the node, but not the one that runs here.
    """
    with LOCK:
        queue: NodeQueue | None = node.__dict__.get("_tf2_callback_queue")
        if queue is None:
            queue = LoopQueue(node) if runs_in_loop(node) else CallbackQueue(node)
            node.__dict__["_tf2_callback_queue"] = queue
    return queue


def queue_of(buffer: object) -> NodeQueue | None:
    """The queue of the node of a buffer's latest listener, of those whose nodes have not ended, if any."""
    contexts = getattr(buffer, "_tf2_wait_contexts", None)
    for reference in reversed(contexts.queues if isinstance(contexts, WaitContexts) else ()):
        queue: NodeQueue | None = reference()
        if queue is not None and not queue.has_ended():
            return queue
    return None


def call_where_served(queue: NodeQueue | None, call: Call | None) -> None:
    """Have what runs the node of a queue make a call, if any; if nothing runs it now, make it here."""
    if call is None:
        return
    if queue is None or queue.has_ended() or not queue.is_served():
        call()
    else:
        queue.put(call)


def hand_over(queue: NodeQueue | None, calls: Iterable[Ending]) -> None:
    """
    Have waits ended by what was received; called by the thread that reports what was inserted.

    :param queue: for those that name none: that of the listener that received it. None: there is no node, so
        this thread must run the callbacks, and logs what they raise.
    """
    for call in calls:
        own = call.queue or queue
        if own is None:
            call_logged(call, "In a callback")
        else:
            own.put(call)
