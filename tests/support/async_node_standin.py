# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Nodes that an asyncio loop runs: rclpy's own, or, in a release without them, a stand-in."""

import asyncio
import inspect

from rclpy.clock import ROSClock
from rclpy.node import Node
from rclpy.qos import qos_profile_services_default

READ_INTERVAL_S = 0.01  # how often the stand-in looks for messages; the real one is informed of them


class StandIn:
    """
    What rclpy 10.0.10 documents of ``AsyncNode``, on a ``Node`` that nothing spins, and nothing else.

    Its services, clients and timers exist, and do nothing.
    """

    def __init__(self, name, **options):
        self._node = Node(name, **options)
        self._clock = ROSClock()
        self._group = None
        self._subscriptions = set()
        self._is_destroyed = False

    context = property(lambda self: self._node.context)
    handle = property(lambda self: self._node.handle)

    async def __aenter__(self):
        if self._is_destroyed:
            raise RuntimeError("Node has been destroyed and cannot be reentered")
        self._group = await asyncio.TaskGroup().__aenter__()
        for one in self._subscriptions:
            one.begin(self._group)
        return self

    async def __aexit__(self, *exception):
        self.destroy_node()
        await self._group.__aexit__(*exception)

    def destroy_node(self):
        self._is_destroyed = True
        for one in list(self._subscriptions):
            one.destroy()
        self._node.destroy_node()

    def get_clock(self):
        return self._clock

    def get_fully_qualified_name(self):
        return self._node.get_fully_qualified_name()

    def count_subscribers(self, topic):
        return self._node.count_subscribers(topic)

    def get_namespace(self):
        return self._node.get_namespace()

    def get_logger(self):
        return self._node.get_logger()

    def resolve_topic_name(self, topic):
        return self._node.resolve_topic_name(topic)

    def resolve_service_name(self, name):
        return self._node.resolve_service_name(name)

    def create_publisher(self, message_type, topic, qos):
        return self._node.create_publisher(message_type, topic, qos)

    def create_subscription(self, message_type, topic, callback, qos):
        made = self._node.create_subscription(message_type, topic, lambda _: None, qos)
        one = StandInSubscription(made, callback, self._end)
        self._subscriptions.add(one)
        if self._group is not None:
            one.begin(self._group)
        return one

    def _end(self, one):
        self._subscriptions.discard(one)
        self._node.destroy_subscription(one.made)

    def create_service(self, service_type, name, callback, *, qos_profile=qos_profile_services_default):
        return self._node.create_service(service_type, name, callback, qos_profile=qos_profile)

    def create_client(self, service_type, name, *, qos_profile=qos_profile_services_default):
        return self._node.create_client(service_type, name, qos_profile=qos_profile)

    def create_timer(self, period_s, callback, autostart=True):
        return self._node.create_timer(period_s, callback, autostart=autostart)


class StandInSubscription:
    def __init__(self, made, callback, on_destroy):
        self.made, self.callback, self._on_destroy, self._task = made, callback, on_destroy, None

    handle = property(lambda self: self.made.handle)
    topic_name = property(lambda self: self.made.topic_name)
    qos_profile = property(lambda self: self.made.qos_profile)

    def begin(self, group):
        self._task = group.create_task(self._read())

    async def _read(self):
        while True:
            with self.handle:
                taken = self.handle.take_message(self.made.msg_type, False)
            if taken is None:
                await asyncio.sleep(READ_INTERVAL_S)
                continue
            result = self.callback(taken[0])
            if inspect.isawaitable(result):
                await result

    def destroy(self):
        if self._task is not None:
            self._task.cancel()
        self._on_destroy(self)


try:
    from rclpy.experimental.async_node import AsyncNode
except ImportError:
    AsyncNode = StandIn
