# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Make the calls that wait in a CallQueue: in the executor or the event loop that runs the node."""

import weakref
from contextlib import suppress
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.waitable import Waitable

from tf2_ros._process.forking import LOCK
from tf2_ros._rclpy import guard_handle, is_in_executor, loop_of, runs_in_loop, waits_for_sets, wake
from tf2_ros._wait.call_queue import CallQueue
from tf2_ros._wait.executor_waitable import ExecutorWaitable

# How often rclpy's EventsExecutor looks for calls. It waits for no guard condition, and a thread that wakes
# it in any other way hangs in some releases, with the GIL.
POLL_S = 0.02


class Runner:
    """What makes the calls of a :class:`~tf2_ros._wait.call_queue.CallQueue`."""

    _call_queue: "weakref.ref[CallQueue]"  # which keeps this

    @property
    def uses_wait_sets(self) -> bool:
        """Whether no ``EventsExecutor`` has had the node: it has arrivals reported to itself."""
        return True

    def begin(self, call_queue: CallQueue) -> None:
        """Serve this, which is being made, from now on."""
        self._call_queue = weakref.ref(call_queue)

    def run(self, count: int | None = None) -> None:
        """Make this many calls, or all that there are now."""
        call_queue = self._call_queue()
        if call_queue is not None:
            call_queue.run(len(call_queue.calls) if count is None else count)

    def wake(self) -> None:
        """Have the calls made soon, from any thread."""
        raise NotImplementedError

    def is_running(self) -> bool:
        """Whether an executor or a loop has the node, and makes calls as soon as no callback blocks it."""
        raise NotImplementedError

    def leave(self) -> None:
        """Undo what has made the node know this."""

    def why_late(self, name: str) -> str:
        """What a user can do about calls that wait."""
        raise NotImplementedError


class _MovableGroup(MutuallyExclusiveCallbackGroup):
    """
    Lets one callback of a node run at a time, also when the node moves to another executor meanwhile.

    That executor sleeps without what is in the group, because a callback runs. When this returns, rclpy wakes
    only the executor that has called it.
    """

    def __init__(self, node: Node) -> None:
        super().__init__()
        self._node = weakref.ref(node)

    def ending_execution(self, entity: Any) -> None:
        super().ending_execution(entity)
        executor = getattr(self._node(), "executor", None)
        if waits_for_sets(executor):
            wake(executor)


class ExecutorRunner(ExecutorWaitable, Runner, Waitable):
    """The executor that spins a node."""

    def __init__(self, node: Node) -> None:
        Waitable.__init__(self, _MovableGroup(node))
        self._node = weakref.ref(node)
        self.set_up(guard_handle(node))

    def begin(self, call_queue: CallQueue) -> None:
        Runner.begin(self, call_queue)
        self.calls = call_queue.calls
        node = self._node()
        if node is not None:
            node.add_waitable(self)

    def is_running(self) -> bool:
        node = self._node()
        return node is not None and is_in_executor(node)

    def leave(self) -> None:
        node = self._node()
        # Another thread may shut the executor down, or remove it, at the same time.
        with suppress(ValueError, AttributeError, InvalidHandle):
            if node is not None and self in node.waitables:
                node.remove_waitable(self)

    def why_late(self, name: str) -> str:
        return (
            f"nobody spins the node [{name}], or one of its callbacks does not return. Spin it in a thread, "
            "for example with rclpy.spin(node)."
        )

    def executor(self) -> Any:
        """The executor that has the node, or had it last; None if there was none, or if it is gone."""
        return getattr(self._node(), "executor", None)

    def yield_to_events_executor(self) -> None:
        """Have a timer look for calls, in any executor, because an ``EventsExecutor`` has taken the node."""
        for receiver in self.receivers:
            receiver.yield_to_events_executor()
        node, clock = self._node(), Clock(clock_type=ClockType.STEADY_TIME)
        if node is not None:
            # Some releases pass a callback that takes an argument when its timer was due.
            node.create_timer(POLL_S, lambda: self.run(), self.callback_group, clock=clock)

    async def execute(self, taken_data: int) -> None:
        """Make this many calls, in an executor."""
        self.run(taken_data)


class LoopRunner(Runner):
    """The asyncio loop that runs a node, which is the one in which this is made."""

    def __init__(self, node: Any) -> None:
        self._loop = loop_of(node)

    def wake(self) -> None:
        try:
            self._loop.call_soon_threadsafe(self._run)
        except RuntimeError:
            call_queue = self._call_queue()
            if call_queue is not None:
                call_queue.drop("the event loop of the node was closed")

    def _run(self) -> None:
        call_queue = self._call_queue()
        if call_queue is not None and call_queue.has_ended():
            call_queue.drop("the node was destroyed")
        else:
            self.run()

    def is_running(self) -> bool:
        return bool(self._loop.is_running())

    def why_late(self, name: str) -> str:
        return f"the event loop of the node [{name}] does not run, or something in it does not return."


def call_queue_of(node: Any) -> CallQueue:
    """
    Get the queue of a node.

    :raises RuntimeError: an event loop runs the node, but not the one that runs here.
    """
    with LOCK:
        found: CallQueue | None = node.__dict__.get("_tf2_call_queue")
        if found is None:
            found = CallQueue(node, LoopRunner(node) if runs_in_loop(node) else ExecutorRunner(node))
            node.__dict__["_tf2_call_queue"] = found
    return found
