# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Spins nodes beside the tests, in threads of their own, and shuts down what spins."""

import itertools
import threading
from contextlib import contextmanager

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.time import Time
from rclpy.waitable import NumberOfEntities, Waitable
from waiting import DEADLINE_S, until

EXECUTOR = "the executor"
LATEST = Time()


@contextmanager
def spinning(executor):
    """Another thread, EXECUTOR, spins the executor."""

    def spin():
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    thread = threading.Thread(target=spin, name=EXECUTOR)
    thread.start()
    try:
        yield executor
    finally:
        shut_down(executor, thread)


def shut_down(executor, thread):
    """
    Shut an executor down that a thread may be spinning, once the thread has ended.

    rclpy's `shutdown()` alone destroys the guard condition of the executor, which the thread may be using.
    """
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


def knows(buffer, child, parent="map", time=LATEST):
    """A condition for `until`: a frame can be looked up in its parent."""
    return lambda: buffer.can_transform(parent, child, time)


class Observer(Waitable):
    """A part of a node in which executors find nothing to do; tests override what they call each round."""

    def __init__(self):
        super().__init__(ReentrantCallbackGroup())

    def __enter__(self):
        pass

    def __exit__(self, *_):
        pass

    def get_num_entities(self):
        return NumberOfEntities()

    def add_to_wait_set(self, _):
        pass

    def is_ready(self, _):
        return False


def shut_down_quietly(context):
    """Shut a context down as rclpy does after a signal: executors that sleep are not woken."""
    context.handle.shutdown()
    context._logging_fini()  # which nobody does after a signal, but later tests need


def queue_of(node):
    """The CallQueue of a node, which tf2 does not have."""
    from tf2_ros._wait.call_runners import call_queue_of

    return call_queue_of(node)


def shut_down_at_sleep(queue):
    """
    Quietly shut down the context of a node, while the executor that spins it goes to sleep.

    :param queue: the CallQueue of the node.
    """
    context, rounds, began = queue.node().context, itertools.count(), threading.Event()

    class AtSleep(Observer):
        def add_to_wait_set(self, _):
            if not began.is_set() or next(rounds) < 3:
                queue.runner.wake()  # until all that has woken the executor before is used up
            elif context.ok():
                shut_down_quietly(context)

    queue.node().add_waitable(AtSleep())
    queue.runner.wake()
    began.set()
    until(lambda: not context.ok())
