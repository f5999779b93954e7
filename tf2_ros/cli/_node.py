"""Owns the node of a program, from the start of ROS to its end."""

from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from tf2_ros._spinner import Spinner
from tf2_ros.buffer import Buffer
from tf2_ros.transform_listener import TransformListener
from tf2_ros_cython.cli._program import UsageError, deferred_signals, interruptible

__all__ = ["filled_buffer", "spun_node"]


@contextmanager
def spun_node(name: str, options: Namespace, **node_options: Any) -> Iterator[Node]:
    """
    A node for a ``with`` statement; a thread spins it, so that it knows the simulated time.

    :param options: of the command line.
    :param node_options: of ``rclpy.create_node``.
    :raises UsageError: the command line has a name or a parameter that ROS refuses.

    The main thread must not wait inside rclpy, for there no signal reaches it.
    """
    with deferred_signals():
        # Without the handlers of rclpy, which would end the context under the hands of the program.
        rclpy.init(args=options.ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
        try:
            node = rclpy.create_node(name, **node_options)
            spinner = Spinner(node, daemon=True, at_end=node.destroy_node)
            try:
                with interruptible():
                    yield node
            finally:
                spinner.stop()
        except (NameValidationException, ParameterException) as refusal:
            raise UsageError(str(refusal)) from None
        finally:
            rclpy.try_shutdown()


@contextmanager
def filled_buffer(
    node: Node,
    listen: Callable[[Buffer, Node], TransformListener] = TransformListener,
    cache_time: Duration | None = None,
) -> Iterator[Buffer]:
    """
    A buffer for a ``with`` statement, which a listener fills, and which follows the clock of the node.

    :param listen: makes the listener.
    :param cache_time: how far the history of each frame reaches back. None: as of any buffer.
    """
    with deferred_signals():
        buffer = Buffer(cache_time, node)
        # Who asks a robot for its frames must not be answered by a program that only looks on.
        if buffer.srv is not None:
            node.destroy_service(buffer.srv)
            buffer.srv = None
        with listen(buffer, node), interruptible():
            yield buffer
