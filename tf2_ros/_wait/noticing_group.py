"""Owns whether an executor serves a node, as far as a callback group of the node notices it."""

import time
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node

from tf2_ros._rclpy import holding_executor, is_spinning

__all__ = ["NoticingGroup", "patience_ns"]

# Programs make a node, and spin it after the rest of their start. Some spin it once in each of their steps.
PATIENCE_S = 5.0


def patience_ns() -> int:
    """For how long a node that nobody spins counts as one that is about to be spun."""
    return int(PATIENCE_S * 1e9)


class NoticingGroup(MutuallyExclusiveCallbackGroup):
    """
    A callback group that knows when an executor last asked it, as each does in each of its rounds.

    :param node: something in this group is part of it.
    """

    def __init__(self, node: Node) -> None:
        super().__init__()
        self._node = node
        # In steady time; 0: never.
        self._asked_ns = 0
        self._held_ns = 0

    def can_execute(self, entity: Any) -> bool:
        """Whether an executor may run it."""
        self._asked_ns = time.monotonic_ns()
        can: bool = super().can_execute(entity)
        return can

    def has_executor(self) -> bool:
        """
        Whether an executor has the node, or had it not long ago.

        It takes a lock of the executor, so LOCK must not be held. A program that calls ``rclpy.spin_once()``
        again and again gives the node to an executor each time, and takes it back.
        """
        if holding_executor(self._node) is not None:
            self._held_ns = time.monotonic_ns()
            return True
        return time.monotonic_ns() < self.free_at_ns()

    def free_at_ns(self) -> int:
        """The steady time until which no thread may act for an executor; 0: there never was one."""
        had_ns = max(self._asked_ns, self._held_ns)
        return had_ns + patience_ns() if had_ns else 0

    def is_spun(self, within_ns: int) -> bool:
        """Whether an executor spins the node, or did so in this time before."""
        if self._asked_ns and time.monotonic_ns() - self._asked_ns < within_ns:
            return True
        executor = holding_executor(self._node)
        return executor is not None and is_spinning(executor)
