"""Owns what a forked child does with the nodes of its parent: it does not touch the middleware."""

import weakref
from typing import Any

from rclpy.node import Node

from tf2_ros._forking import keep_for_ever, register_for_fork
from tf2_ros._rclpy import node_handles
from tf2_ros._receive.exit_handlers import skip_exit_handlers

__all__ = ["NodeUse"]


class NodeUse:
    """
    A node through which this process communicates.

    In a forked child the threads of the middleware are missing, so that destroying any part of the node may
    hang, also at the child's exit. There no part of it is ever destroyed, while this object exists.
    """

    def __init__(self, node: Any) -> None:
        self.forked = False  # whether the node is that of a parent process
        self._node = weakref.ref(node) if isinstance(node, Node) else None
        register_for_fork(self)

    def after_fork(self) -> None:
        """See the class."""
        self.forked = True
        node = None if self._node is None else self._node()
        if node is not None:
            keep_for_ever(*node_handles(node))
        # Those of the middleware join threads that the child does not have.
        skip_exit_handlers()
