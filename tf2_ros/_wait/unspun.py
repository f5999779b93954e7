"""Owns the warning that nobody spins the node of a subscription whose messages somebody relies on."""

import time
from collections.abc import Callable

from rclpy.node import Node

from tf2_ros._wait.contexts import node_has_ended
from tf2_ros._wait.deadlines import deadlines

__all__ = ["UnspunWarning"]

PATIENCE_S = 5.0  # programs make a node, and spin it after the rest of their start


class UnspunWarning:
    """
    A warning of the node's logger, at most one, PATIENCE_S after somebody began to rely on a subscription.

    :param has_executor: whether the node has, or ever had, an executor.

    It is to be kept as long as the subscription exists.
    """

    def __init__(self, node: Node, topic: str, has_executor: Callable[[], bool]) -> None:
        self._node = node
        self._names = (topic, node.get_fully_qualified_name())
        self._has_executor = has_executor
        self._begun = False

    def rely(self) -> None:
        """Somebody relies on the messages from now on."""
        if not self._begun:
            self._begun = True
            deadlines.add(time.monotonic_ns() + int(PATIENCE_S * 1e9), self)

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Whether there is nothing to warn of."""
        return self._has_executor() or node_has_ended(self._node)

    def expire(self) -> None:
        """Say so: nobody has spun the node."""
        topic, node = self._names
        self._node.get_logger().warning(
            f"A MessageFilter gets no messages of [{topic}], because nobody spins the node [{node}]. "
            f"Spin it in a thread, for example with rclpy.spin(node)."
        )
