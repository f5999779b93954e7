# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Refuse destroyed nodes, and recognize those that have ended."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rclpy.exceptions import InvalidHandle

from tf2_py._internal import MalformedObjectError
from tf2_ros._arguments import kind_of
from tf2_ros._rclpy import context_was_shut_down, handle_exists, is_node


def require_node(call: str, node: Any, method: str, other: object = None, order: str = "") -> None:
    """
    Refuse what cannot serve as a node, before anything is made.

    :param other: the argument with which a program may have swapped the node; ``order`` is the right one.
    :raises TypeError: it lacks the method; also an AttributeError, as in tf2.
    :raises InvalidHandle: it was destroyed.
    """
    if not hasattr(node, method):
        advice = f"; pass {order}" if hasattr(other, method) else ""
        raise MalformedObjectError(f"{call}: expected a node with {method}, got {kind_of(node)}{advice}")
    if is_node(node) and not handle_exists(node.handle):
        raise InvalidHandle(f"{call}: the node was destroyed")


def node_has_ended(node: Any) -> bool:
    """Whether a node receives nothing any more, because it was destroyed or its context was shut down."""
    if not is_node(node):
        return False  # of a program's own kind, or a mock
    return not handle_exists(node.handle) or context_was_shut_down(node.context)


@contextmanager
def suppress_at_end(node: Any) -> Iterator[None]:
    """
    Suppress what rclpy raises because a node has ended, which it may do while rclpy uses it.

    rclpy raises an InvalidHandle for a destroyed node, and an RCLError after the shutdown of its context.
    """
    try:
        yield
    except RuntimeError:
        if not node_has_ended(node):
            raise
