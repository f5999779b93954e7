"""Owns the state of a forked child: its locks are free, and it does not touch the middleware."""

import os
import threading
import weakref
from typing import Any, Protocol

from rclpy.node import Node

from tf2_py._internal import keep_for_ever, skip_exit_handlers
from tf2_ros._rclpy import node_handles

__all__ = ["LOCK", "Inherited", "NodeUse", "keep_for_ever", "register_for_fork"]

# For short steps of waiting, none of which runs user code. One for the whole process, so that a fork can wait
# for all of them; reentrant, because finalizers and signal handlers may wait, too.
LOCK = threading.RLock()


class Inherited(Protocol):
    """What a forked child gets from its parent."""

    def after_fork(self) -> None:
        """Called in the child, whose only thread is the one that forked."""


# By their addresses: a subclass may have no hash.
_inherited: "dict[int, weakref.ref[Inherited]]" = {}


def register_for_fork(owner: Inherited) -> None:
    """Call ``after_fork()`` of this in every forked child, as long as something else refers to it."""
    address, forget = id(owner), _inherited.pop
    _inherited[address] = weakref.ref(owner, lambda _: forget(address, None))


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


def _after_fork_in_child() -> None:
    LOCK.release()
    inherited = [reference() for reference in list(_inherited.values())]
    for owner in inherited:
        if owner is not None:
            owner.after_fork()
    if any(isinstance(owner, NodeUse) for owner in inherited):
        # Those of the middleware join threads that the child does not have.
        skip_exit_handlers()


os.register_at_fork(before=LOCK.acquire, after_in_parent=LOCK.release, after_in_child=_after_fork_in_child)
