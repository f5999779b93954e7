# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Nodes and what uses them, ended in any order, leave nothing behind."""

import asyncio
import gc
import itertools
import random
import threading
import weakref

import pytest
from async_node_standin import AsyncNode
from excused_faults import accept
from geometry_msgs.msg import PointStamped
from random_runs import seeds
from rclpy.exceptions import InvalidHandle
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from spinning_nodes import shut_down
from times_and_transforms import transform
from waiting import until

from tf2_ros import (
    Buffer,
    BufferClient,
    BufferServer,
    MessageFilter,
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformListener,
)
from tf2_ros._nodes.topic_publishers import clock_publishers

# rclpy never frees what it keeps for each name of a node, nor the service that describes types.
NAMES = itertools.cycle(f"random_{i}" for i in range(32))
WITHOUT_SERVICE = [Parameter("start_type_description_service", value=False)]
MOST = 4  # nodes at a time; as many executors


def is_free(node):
    return node.may_be_spun and (node.executor is None or node.executor._is_shutdown)


def spin(executor):
    while not executor._is_shutdown:
        try:
            executor.spin()
        except InvalidHandle as error:
            accept(error)  # a part of a node was destroyed while the executor gathered them


def listen(node, buffer):
    return TransformListener(buffer, node)


def listen_with_thread(node, buffer):
    return TransformListener(buffer, node, spin_thread=is_free(node))


def filter_points(node, buffer):
    made = MessageFilter((PointStamped, "/points", 10), buffer, "map", 5, node=node)
    message = PointStamped()
    message.header.frame_id = "nowhere"
    made.add(message)
    return made


def wait(node, buffer):
    return buffer.wait_for_transform_async("map", "nowhere", Time(), timeout=3600.0)


def serve(node, buffer):
    # An executor of rclpy may fail if another thread destroys an action server of its node.
    return ask(node) if node.may_be_spun else BufferServer(buffer, node, "random_lookup")


def serve_and_end(node, buffer):
    BufferServer(buffer, node, "random_lookup").destroy()


def ask(node, _=None):
    return BufferClient(node, "random_lookup")


def broadcast(node, _):
    return TransformBroadcaster(node)


def broadcast_static(node, _):
    return StaticTransformBroadcaster(node)


# What uses a node, and the method that ends it.
USES = [(listen, "unregister"), (filter_points, "close")] * 2
USES += [(listen_with_thread, "unregister"), (wait, "cancel"), (serve, "destroy"), (ask, "destroy")]
USES += [(broadcast, None), (broadcast_static, None)]


class RandomEnds:
    """Makes and ends things; it keeps only what a program would keep."""

    def __init__(self, ros, seed):
        self.ros, self.random = ros, random.Random(seed)
        self.nodes, self.users, self.executors = [], [], []
        self.made = []  # weakly; everything

    def play(self, steps):
        """Take so many steps, and end what is left in random order."""
        makes = [self.add_node] * 2 + [self.use_node] * 3 + [self.make_executor, self.use_no_node]
        ends = {self.end_node: self.nodes, self.end_user: self.users, self.end_executor: self.executors}
        for _ in range(steps):
            step = self.random.choice([*makes, *ends])
            if ends.get(step, True):
                step()
        while left := [end for end, things in ends.items() if things]:
            self.random.choice(left)()

    def left(self):
        """The names of the classes of what still exists after a collection."""
        gc.collect()
        return sorted(type(one).__name__ for reference in self.made if (one := reference()) is not None)

    def note(self, *made):
        self.made += [weakref.ref(one) for one in made]

    def pop(self, things):
        return things.pop(self.random.randrange(len(things)))

    def add_node(self):
        if len(self.nodes) < MOST:
            node = self.ros.create_node(next(NAMES), parameter_overrides=WITHOUT_SERVICE)
            node.may_be_spun = self.random.random() < 0.6
            self.nodes.append(node)
            self.note(node)

    def make_executor(self):
        if len(self.executors) == MOST:
            return
        executor = self.random.choice([SingleThreadedExecutor, MultiThreadedExecutor])()
        for node in self.nodes:
            if is_free(node) and self.random.random() < 0.5:
                executor.add_node(node)
        thread = threading.Thread(target=spin, args=(executor,))
        self.executors.append((executor, thread))
        self.note(executor, thread)
        if self.random.random() < 0.5:
            thread.start()

    def use_node(self):
        if not self.nodes:
            return
        node, buffer = self.random.choice(self.nodes), Buffer()
        buffer.set_transform(transform("map", "base", 1), "test")
        make, end = self.random.choice(USES)
        user = make(node, buffer)
        self.note(user, buffer)
        # Half of them end themselves; the others with their node, and the program forgets some before.
        self.users.append(self.random.choice([(user, end), (user, None), (None, None)]))

    def use_no_node(self):
        buffer = Buffer()
        listener = TransformListener(buffer)
        self.note(buffer, listener, listener.node, listener.executor, listener.dedicated_listener_thread)
        self.users.append((listener, "unregister"))

    def end_node(self):
        self.pop(self.nodes).destroy_node()

    def end_user(self):
        user, end = self.pop(self.users)
        if end is not None:
            getattr(user, end)()

    def end_executor(self):
        executor, thread = self.pop(self.executors)
        if thread.is_alive():
            shut_down(executor, thread)
        else:
            executor.shutdown()


@pytest.mark.parametrize("use", [listen, filter_points, wait, serve_and_end, broadcast, broadcast_static])
@pytest.mark.parametrize("kind", [Node, AsyncNode])
def test_the_next_collection_frees_a_node_that_has_ended(ros, kind, use):
    """Otherwise a finalizer has made something that refers to it."""

    async def handle_of_ended():
        node = kind("ended")
        handle = weakref.ref(node.handle)
        user = use(node, Buffer())
        node.destroy_node()
        del user
        return handle

    def is_freed():
        handle = asyncio.run(handle_of_ended())
        gc.collect()
        return handle() is None

    assert any(is_freed() for _ in range(3)), "a regular check may use it just then, but not always"


@pytest.mark.parametrize("end", ["destroy_node", "shutdown"])
def test_an_ended_node_knows_no_publishers(ros, node, end):
    node.create_publisher(Clock, "/clock", 10)
    until(lambda: clock_publishers(node) == ["/listening"])
    getattr(node if end == "destroy_node" else ros, end)()
    assert clock_publishers(node) == []


@pytest.mark.parametrize("seed", seeds(5, 50))
def test_nothing_is_left_of_what_ended_in_random_order(ros, seed):
    ends = RandomEnds(ros, seed)
    ends.play(40)
    # The threads of the last ones may be ending.
    until(lambda: ends.left() == [])
