"""Owns what an executor sees of a receiver: that messages arrived, and the users' code that they set off."""

import sys
import threading
import traceback
import weakref
from collections import deque
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.guard_condition import GuardCondition
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import HistoryPolicy
from rclpy.subscription import Subscription
from rclpy.waitable import NumberOfEntities, Waitable

__all__ = ["Arrivals", "queue_depth"]

ENDLESS = 2**63 - 1

# The executor's own loops: between their rounds no code of a user runs that could look at a buffer.
LOOPS = frozenset({"spin", "spin_until_future_complete"})
LOOPING_MODULES = frozenset({"rclpy", "rclpy.executors"})


class _OneGuardCondition(NumberOfEntities):
    """Added to other numbers in each round of an executor, where the addition of rclpy 7 takes 5 us."""

    def __radd__(self, other: NumberOfEntities) -> NumberOfEntities:
        other.num_guard_conditions += 1
        return other


_ONE_GUARD_CONDITION = _OneGuardCondition(0, 1)

Completion = Callable[[], None]


class Arrivals(Waitable):
    """
    Tells the executor of a node of messages that a receiver took beside it.

    :param node: the listener's. It must hold this, by ``add_waitable()``, until :meth:`close`.
    :param group: in which callback group the users' code runs.
    :param count: makes the counter of the messages, given the guard condition's handle.

    ``spin_once()`` returns once for each message, as if the executor had taken it. In the loops of an
    executor (``rclpy.spin``, ``spin``, ``spin_until_future_complete``) that would be for nothing, so these
    are woken for users' code alone.

    That code runs in the executor as soon as the node has ever had one, otherwise in a thread of its own.
    """

    def __init__(self, node: Node, group: CallbackGroup, count: Callable[[Any], Any]) -> None:
        super().__init__(group)
        self._node = weakref.ref(node)
        self._guard = GuardCondition(None, None, node.context)
        self.count = count(self._guard.handle)
        # One entry for each message that completed something: it counts for that message, too.
        self._completed: deque[list[Completion]] = deque()
        self._looked_at = True
        self._spun = False
        self._closed = False
        self._starting = threading.Lock()
        self._thread: threading.Thread | None = None

    def hand_over(self, completions: list[Completion]) -> None:
        """Have the executor call these, in this order; from any thread."""
        self._completed.append(completions)
        if self._has_executor():
            self._guard.trigger()
        else:
            self._start_thread()

    def close(self) -> None:
        """Leave the node; what has been handed over is still called."""
        self._closed = True
        node = self._node()
        if node is not None and self in node.waitables:
            node.remove_waitable(self)
        if self._completed:
            self._start_thread()

    # What an executor asks of a Waitable.

    def __enter__(self) -> None:
        """Do nothing: nobody destroys the guard condition before it goes together with this."""

    def __exit__(self, *_: object) -> None:
        """Do nothing, either."""

    def get_num_entities(self) -> NumberOfEntities:
        """The guard condition alone."""
        return _ONE_GUARD_CONDITION

    def add_to_wait_set(self, wait_set: Any) -> None:
        """An executor is going to sleep."""
        self._spun = True
        self._looked_at = _is_looked_at()
        if self._is_ready(waiting=True):
            self._guard.trigger()
        wait_set.add_guard_condition(self._guard.handle)

    def is_ready(self, wait_set: Any) -> bool:
        """Whether there is something to take."""
        return self._is_ready(waiting=False)

    def take_data(self) -> list[Completion]:
        """One message with what it completed; in an executor's own loop, all of them."""
        if not self._looked_at:
            return [completion for entry in self._drain() for completion in entry]
        if self._completed:
            return self._completed.popleft()
        self.count.take_one()
        return []

    async def execute(self, taken_data: list[Completion]) -> None:
        """Call what was completed; what one of them raises comes after all of them were called."""
        _call(taken_data)

    def _is_ready(self, waiting: bool) -> bool:
        if self._looked_at:
            return bool(self.count.any(waiting) or self._completed)
        self.count.clear()
        return bool(self._completed)

    def _drain(self) -> Sequence[list[Completion]]:
        return [self._completed.popleft() for _ in range(len(self._completed))]

    def _has_executor(self) -> bool:
        if self._closed:
            return False
        if not self._spun:
            # Added to one that has not come round yet.
            node = self._node()
            self._spun = node is not None and node.executor is not None
        return self._spun

    def _start_thread(self) -> None:
        with self._starting:
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="tf2_ros callbacks", daemon=True)
                self._thread.start()

    def _run(self) -> None:
        while True:
            with self._starting:
                if not self._completed or self._has_executor():
                    self._thread = None
                    break
            try:
                _call(self._completed.popleft())
            except BaseException:
                # Nobody is above to catch it.
                get_logger("tf2_ros").error(f"In a callback of a future: {traceback.format_exc()}")
        if self._completed:
            self._guard.trigger()


def queue_depth(subscription: Subscription) -> int:
    """How many messages a subscription holds until they are taken."""
    qos = subscription.qos_profile
    return ENDLESS if qos.history == HistoryPolicy.KEEP_ALL else max(1, qos.depth)


def _call(completions: list[Completion]) -> None:
    error: BaseException | None = None
    for completion in completions:
        try:
            completion()
        except BaseException as raised:
            error = error or raised
    if error is not None:
        raise error


def _is_looked_at() -> bool:
    # Whether code of a user runs before the executor sleeps again: it does where rclpy was called by
    # something else than its own loops.
    frame: FrameType | None = sys._getframe(2)
    while frame is not None and frame.f_globals.get("__name__") in LOOPING_MODULES:
        if frame.f_code.co_name in LOOPS:
            return False
        frame = frame.f_back
    return True
