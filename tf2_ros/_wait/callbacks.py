"""Run a program's callbacks in the queue of their node: in which thread, and when."""

import time
import weakref
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.waitable import Waitable

from tf2_py._internal import call_all
from tf2_ros._forking import LOCK, register_for_fork
from tf2_ros._nodes import ShutdownWaker, WaitContexts, node_has_ended
from tf2_ros._rclpy import holding_executor, is_in_callback, new_wake_handle
from tf2_ros._wait.rounds import ExecutorRounds
from tf2_ros._wait.timers import LINGER_S, Worker, deadlines

Call = Callable[[], object]
Tell = Callable[[bool], object]

# Programs make a node, and spin it when the rest has started. Some spin it once in each of their steps.
PATIENCE_S = 5.0


def patience_ns() -> int:
    """How long a node that is not spun counts as one that is about to be spun, in nanoseconds."""
    return int(PATIENCE_S * 1e9)


class CallbackQueue(ExecutorRounds, Waitable):
    """
    Runs callbacks of a program one at a time, in the order of :meth:`put`.

    :param node: keeps this object alive. None: a thread runs the calls.
    :param group: the callback group that they run in; None: a separate one.
    :param by_thread: whether a thread may also run them.

    The executor that has the node runs the calls, as long as it is inside a callback of the node, and for
    PATIENCE_S after its last sign: a round with this queue, or having taken the node over. After that, and
    if there never was an executor, a thread runs the calls until the next sign. So no call runs at the same
    time as a callback of a node that is spun, however rarely, and each call runs at most PATIENCE_S after it
    was put, even if the node was left in an executor that is not spun, or was dropped.
    """

    def __init__(
        self, node: Node | None = None, group: CallbackGroup | None = None, *, by_thread: bool = True
    ) -> None:
        Waitable.__init__(self, MutuallyExclusiveCallbackGroup() if group is None else group)
        self._node = None if node is None else weakref.ref(node)
        self._guard: Any = None
        self._closed = False
        self._by_thread = by_thread
        self._thread = _CallbackThread(self)
        self._offered_ns = 0  # steady time since which a call has been waiting for an executor; 0: none does
        self._check_ns = 0  # steady time at which the thread looks whether one has come
        self._task_of = 0  # the executor, by its id, that has a task of this
        # The last sign and the executor when the thread took over; None while it does not run the calls.
        self._given_up: tuple[int, int] | None = (0, 0)
        register_for_fork(self)
        if node is not None:
            if node.executor is not None:
                self._given_up = None
            self._guard = new_wake_handle(node.context)
            self.set_up(self._guard)
            self._waker = ShutdownWaker(node.context, self._guard)
            node.add_waitable(self)

    def put(self, call: Call) -> None:
        """Add a call, from any thread, signal handler or finalizer; without effect after :meth:`close`."""
        if self._closed:
            return
        self.calls.append(call)
        self.offer()

    def put_all(self, calls: Sequence[Call]) -> None:
        """
        Add calls that run one after the other, even if one of them raises.

        Those that have an attribute ``queue`` are added to that queue instead.
        """
        others: dict[CallbackQueue, list[Call]] = {}
        for call in calls:
            queue: CallbackQueue = getattr(call, "queue", None) or self
            others.setdefault(queue, []).append(call)
        for queue, own in others.items():
            queue.put(partial(call_all, own))

    def inform(self, before_sleep: Tell) -> None:
        """
        Call this before an executor sleeps, with whether user code called the executor.

        It is also called when an executor has taken the node that does not wait for sets (``in_sets``). The
        queue, and so the node, keeps its object alive.
        """
        with LOCK:  # other threads make and end listeners of the same node
            self.sleepers += (before_sleep,)

    def inform_no_more(self, before_sleep: Tell) -> None:
        """Undo :meth:`inform`."""
        with LOCK:
            self.sleepers = tuple(one for one in self.sleepers if one != before_sleep)

    def offer(self) -> None:
        """Have an executor or the thread run what is in the queue."""
        with suppress(RuntimeError):  # no thread can be started now; the check or the next call tries again
            if self._is_left_to_thread():
                self._thread.begin()
                return
            self._wake_executor()
        with suppress(RuntimeError):
            if self._by_thread:
                self._check_later()

    def is_spun(self) -> bool:
        """Whether an executor spins the node, or had a round with it in the last PATIENCE_S."""
        if self.asked_ns and time.monotonic_ns() - self.asked_ns < patience_ns():
            return True
        node = self.node()
        executor = None if node is None else holding_executor(node)
        return executor is not None and (self.sleeps() or is_in_callback(executor))

    def close(self) -> None:
        """Forget the calls, and leave the node."""
        self._closed = True
        self.calls.clear()
        node, self._node = self.node(), None
        if node is not None and self in node.waitables:
            node.remove_waitable(self)

    def __del__(self) -> None:
        """Leave the calls to the queue of the process, because the node was dropped."""
        if self._by_thread and self.calls:
            _without_node.put_all(tuple(self.calls))

    def after_fork(self) -> None:
        """Leave the calls and the node to the parent, in a forked child."""
        self.calls.clear()
        self.running = False
        self._thread.begin_anew()
        self._node, self._given_up, self._check_ns = None, (self.asked_ns, 0), 0

    def node(self) -> Node | None:
        """The node, if it exists."""
        return None if self._node is None else self._node()

    def executor(self) -> Any:
        """See :class:`ExecutorRounds`."""
        node = self.node()
        return None if node is None else node.executor

    async def execute(self, taken_data: int) -> None:
        """Run this many calls, in an executor."""
        self._offered_ns = 0
        try:
            self.run(taken_data)
        finally:
            self.asked()
            if self.calls:
                self.offer()

    def thread_may_run(self) -> bool:
        """
        Whether the thread must run what is in the queue; otherwise it has been offered to an executor.

        It is called in that thread, because it takes a lock of the executor.
        """
        node = self.node()
        if node is None:
            return True
        executor = holding_executor(node)
        found = (self.asked_ns, id(executor) if executor is not None else 0)
        if self._given_up == found:
            return True
        now_ns = time.monotonic_ns()
        if executor is not None and is_in_callback(executor):
            self._offered_ns = now_ns
        elif node_has_ended(node) or now_ns >= self._free_at_ns():
            self._given_up, self._offered_ns, self._task_of = found, 0, 0
            return True
        self._given_up = None
        self._wake_executor()
        self._check_later()
        return False

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Whether no more checks are needed: never."""
        return False

    def expire(self) -> None:
        """Check whether an executor has run the calls."""
        self._check_ns = 0
        if self.calls:
            try:
                self._thread.begin()
            except RuntimeError:
                self._check_later()
                raise

    def _is_left_to_thread(self) -> bool:
        """Whether no executor runs the calls. It takes no lock of an executor, so any thread may ask."""
        if not self._by_thread:
            return False
        if self._given_up is not None and self._given_up[0] == self.asked_ns:
            return True
        node = self.node()
        return node is None or node_has_ended(node)

    def _free_at_ns(self) -> int:
        """The steady time from which the thread may act for an executor that gives no sign."""
        if not self._offered_ns:
            return time.monotonic_ns() + patience_ns()
        return max(self.asked_ns, self._offered_ns) + patience_ns()

    def _wake_executor(self) -> None:
        if not self._offered_ns:
            self._offered_ns = time.monotonic_ns()
        executor = self.executor()
        if executor is None or isinstance(executor, Executor):
            self.wake()
        elif self._task_of != id(executor):
            # An EventsExecutor waits for no guard condition.
            executor.create_task(self._run_as_task)
            self._task_of = id(executor)

    def _run_as_task(self) -> None:
        self._task_of = self._offered_ns = 0
        self.asked()
        ran = True
        try:
            ran = self.run(len(self.calls))
        finally:
            self.asked()
            # A thread that is inside a call offers the rest at its end.
            if self.calls and ran:
                self.offer()

    def _check_later(self) -> None:
        if self._check_ns <= time.monotonic_ns():
            check_ns = self._free_at_ns()
            deadlines.add(check_ns, self)
            self._check_ns = check_ns


class _CallbackThread(Worker):
    """Runs the calls of a queue that no executor runs."""

    def __init__(self, queue: CallbackQueue) -> None:
        self._queue = weakref.ref(queue)
        super().__init__("tf2_ros callbacks")

    def _work(self) -> float:
        while self._has_work() and (queue := self._queue()) is not None:
            queue.run(1)
        return LINGER_S

    def _has_work(self) -> bool:
        queue = self._queue()
        # An executor that is inside one of the calls offers those that are left at its end.
        return queue is not None and bool(queue.calls) and not queue.running and queue.thread_may_run()


# For calls that belong to no node, one for the whole process.
_without_node = CallbackQueue()


def callback_queue(node: object) -> CallbackQueue:
    """Get the queue of an rclpy node, or otherwise the queue of the process, whose calls a thread runs."""
    if not isinstance(node, Node):
        return _without_node
    with LOCK:
        queue: CallbackQueue | None = node.__dict__.get("_tf2_callback_queue")
        if queue is None:
            queue = node.__dict__["_tf2_callback_queue"] = CallbackQueue(node)
    return queue


def queue_of(buffer: object) -> CallbackQueue:
    """Get the queue of the node whose listener fills, or last filled, a buffer; or that of the process."""
    contexts = getattr(buffer, "_tf2_wait_contexts", None)
    return callback_queue(contexts.listening_node() if isinstance(contexts, WaitContexts) else None)
