# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Provide a node that a thread spins, for programs."""

# First, because its errors say in one line what is missing, or that another tf2_ros is imported.
import tf2_ros.transform_listener  # noqa: F401

# isort: split

import threading
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.exceptions import InvalidHandle, NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from tf2_ros_tools.common.program import UsageError

CALLBACK_END_WAIT_S = 1.0  # for a callback that runs when the program is to end


@contextmanager
def spun_node(name: str, options: Namespace) -> Iterator[Node]:
    """
    A node for a ``with`` statement. A thread spins it, so that it knows the simulated time.

    :param options: of the command line.
    :raises UsageError: the command line contains a name or a parameter that ROS refuses.

    The main thread must not wait inside rclpy, because no signal would reach it there.
    """
    # Without the handlers of rclpy, which would shut the context down while the program uses it.
    rclpy.init(args=options.ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node(name)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        thread = threading.Thread(target=_spin, args=(executor,), daemon=True)
        thread.start()
        try:
            yield node
        finally:
            # This also ends the thread, which may use the executor until then.
            rclpy.try_shutdown()
            thread.join(CALLBACK_END_WAIT_S)
            if not thread.is_alive():
                executor.shutdown()
                node.destroy_node()
    except (NameValidationException, ParameterException) as refusal:
        raise UsageError(str(refusal)) from None
    finally:
        rclpy.try_shutdown()


def _spin(executor: SingleThreadedExecutor) -> None:
    while executor.context.ok():
        try:
            executor.spin()
        except InvalidHandle:
            continue  # a part of the node was destroyed while the executor gathered them
        except ExternalShutdownException:
            return
        except Exception:
            if executor.context.ok():
                raise
            # The context ended between two checks of the executor.
