"""Spins nodes beside the tests."""

import threading
from contextlib import contextmanager

import rclpy
from processes import DEADLINE_S
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor


@contextmanager
def spinning(executor):
    """Another thread spins the executor."""

    def spin():
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    thread = threading.Thread(target=spin)
    thread.start()
    try:
        yield executor
    finally:
        # As shutdown() begins; the rest would pull parts away that the thread is using.
        executor._is_shutdown = True
        if executor.context.ok():
            executor.wake()
        thread.join(DEADLINE_S)
    assert not thread.is_alive()
    executor.shutdown()


@contextmanager
def spun_node(name):
    """A node of a context of its own, that another thread spins."""
    context = rclpy.Context()
    context.init()
    node = rclpy.create_node(name, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        with spinning(executor):
            yield node
    finally:
        node.destroy_node()
        context.try_shutdown()
