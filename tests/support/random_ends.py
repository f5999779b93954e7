"""Nodes, and what uses nodes, made and ended in random order."""

import gc
import itertools
import random
import threading
import weakref

import rclpy
from geometry_msgs.msg import PointStamped
from making import transform
from rclpy.exceptions import InvalidHandle
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.time import Time

from tf2_ros import (
    Buffer,
    BufferClient,
    BufferServer,
    MessageFilter,
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformListener,
)

# rclpy never frees what it keeps for each name of a node, nor the service that describes types.
NAMES = itertools.cycle(f"random_{i}" for i in range(32))
WITHOUT_SERVICE = [Parameter("start_type_description_service", value=False)]
MOST = 4  # nodes at a time; as many executors


class RandomEnds:
    """Makes and ends things; it keeps only what a program would keep."""

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.nodes, self.users, self.executors = [], [], []
        self.made = []  # weakly; everything

    def play(self, steps):
        """Take so many steps, and end what is left in random order."""
        for _ in range(steps):
            self.random.choice(self.MOVES)(self)
        while ends := [end for end in self.ENDS if self.held(end)]:
            self.random.choice(ends)(self)

    def left(self):
        """The names of the classes of what still exists after a collection."""
        gc.collect()
        return sorted(type(one).__name__ for reference in self.made if (one := reference()) is not None)

    def held(self, end):
        return {"end_node": self.nodes, "end_user": self.users, "end_executor": self.executors}[end.__name__]

    def note(self, *made):
        self.made += [weakref.ref(one) for one in made]

    def pop(self, things):
        return things.pop(self.random.randrange(len(things)))

    def add_node(self):
        if len(self.nodes) < MOST:
            node = make_node()
            # An executor of rclpy may fail if another thread destroys an action server of its node, and if
            # another executor takes the node over.
            node.may_be_spun = self.random.random() < 0.6
            self.nodes.append(node)
            self.note(node)

    def make_executor(self):
        if len(self.executors) == MOST:
            return
        executor = self.random.choice([SingleThreadedExecutor, MultiThreadedExecutor])()
        for node in self.nodes:
            if _is_free(node) and self.random.random() < 0.5:
                executor.add_node(node)
        thread = threading.Thread(target=_spin, args=(executor,)) if self.random.random() < 0.5 else None
        self.executors.append((executor, thread))
        self.note(executor)
        if thread is not None:
            self.note(thread)
            thread.start()

    def use_node(self):
        if not self.nodes:
            return
        node, buffer = self.random.choice(self.nodes), Buffer()
        buffer.set_transform(transform("map", "base", 1), "test")
        user, end = self.random.choice(self.USES)(node, buffer)
        self.note(user, buffer)
        # Half of them end themselves; the others with their node, and the program forgets some before.
        self.users.append(self.random.choice([(end, user), (None, user), (None, None)]))
        del user, buffer

    def use_no_node(self):
        buffer = Buffer()
        listener = TransformListener(buffer)
        self.note(buffer, listener, listener.node, listener.executor, listener.dedicated_listener_thread)
        self.users.append((listener.unregister, listener))

    def end_node(self):
        if self.nodes:
            self.pop(self.nodes).destroy_node()

    def end_user(self):
        if self.users:
            end, _ = self.pop(self.users)
            if end is not None:
                end()

    def end_executor(self):
        if self.executors:
            executor, thread = self.pop(self.executors)
            executor.shutdown()
            if thread is not None:
                thread.join()

    @staticmethod
    def listen(node, buffer, **how):
        listener = TransformListener(buffer, node, **how)
        return listener, listener.unregister

    @staticmethod
    def listen_with_thread(node, buffer):
        return RandomEnds.listen(node, buffer, spin_thread=_is_free(node))

    @staticmethod
    def filter(node, buffer):
        filtering = MessageFilter((PointStamped, "/points", 10), buffer, "map", 5, node=node)
        message = PointStamped()
        message.header.frame_id = "nowhere"
        filtering.add(message)
        return filtering, filtering.close

    @staticmethod
    def wait(node, buffer):
        future = buffer.wait_for_transform_async("map", "nowhere", Time(), timeout=3600.0)
        return future, future.cancel

    @staticmethod
    def serve(node, buffer):
        if node.may_be_spun:
            return RandomEnds.ask(node, buffer)
        server = BufferServer(buffer, node, "random_lookup")
        return server, server.destroy

    @staticmethod
    def ask(node, buffer):
        client = BufferClient(node, "random_lookup")
        return client, client.destroy

    @staticmethod
    def send(node, buffer):
        return TransformBroadcaster(node), None

    @staticmethod
    def send_static(node, buffer):
        return StaticTransformBroadcaster(node), None

    USES = (listen, listen, listen_with_thread, filter, filter, wait, serve, ask, send, send_static)
    ENDS = (end_node, end_user, end_executor)
    MOVES = (add_node, add_node, make_executor, use_node, use_node, use_node, use_no_node, *ENDS)


def make_node():
    """A node that leaves almost nothing behind."""
    return rclpy.create_node(next(NAMES), parameter_overrides=WITHOUT_SERVICE)


def _is_free(node):
    return node.may_be_spun and (node.executor is None or node.executor._is_shutdown)


def _spin(executor):
    while not executor._is_shutdown:
        try:
            executor.spin()
        except InvalidHandle:
            continue  # a part of a node was destroyed while the executor gathered them
