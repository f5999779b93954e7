"""Owns the warning that nobody spins the node of a subscription whose messages somebody relies on."""

import time

from rclpy.node import Node

from tf2_ros._wait.contexts import node_has_ended
from tf2_ros._wait.deadlines import deadlines
from tf2_ros._wait.noticing_group import NoticingGroup, patience_ns

__all__ = ["UnspunWarning"]

CHECKS = 5  # while the patience lasts: a spin that ends at once is then not taken for one that goes on


class UnspunWarning:
    """
    A warning of the node's logger, at most one, when nobody has spun the node for some seconds.

    :param group: something in this callback group is part of the node.

    It begins when somebody relies on the subscription, and is to be kept as long as the subscription exists.
    """

    def __init__(self, node: Node, topic: str, group: NoticingGroup) -> None:
        self._node = node
        self._names = (topic, node.get_fully_qualified_name())
        self._group = group
        self._spun_ns = 0  # steady time at which somebody was last seen spinning, or relied on it first

    def rely(self) -> None:
        """Somebody relies on the messages from now on."""
        if not self._spun_ns:
            self._spun_ns = time.monotonic_ns()
            self._check_later()

    # The protocol of what has a deadline.

    def over(self) -> bool:
        """Whether there is nothing to warn of any more."""
        return node_has_ended(self._node)

    def expire(self) -> None:
        """Look who spins the node; say so if nobody has for long."""
        now_ns = time.monotonic_ns()
        if self._group.is_spun(within_ns=patience_ns() // CHECKS):
            self._spun_ns = now_ns
        if now_ns - self._spun_ns < patience_ns():
            self._check_later()
            return
        topic, node = self._names
        self._node.get_logger().warning(
            f"A MessageFilter gets no messages of [{topic}], because nobody spins the node [{node}]. "
            f"Spin it in a thread, for example with rclpy.spin(node)."
        )

    def _check_later(self) -> None:
        deadlines.add(time.monotonic_ns() + patience_ns() // CHECKS, self)
