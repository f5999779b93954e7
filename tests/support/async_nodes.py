"""rclpy's AsyncNode, or what stands in for it in releases before rclpy 10."""

import asyncio
from contextlib import suppress

import rclpy

try:
    from rclpy.experimental import AsyncNode
except ImportError:

    class AsyncSubscription:
        """A subscription whose messages the loop takes."""

        def __init__(self, node, subscription, callback):
            self._node = node
            self.subscription = subscription
            self.callback = callback

        def destroy(self):
            self._node.entities.discard(self)
            self._node.inner.destroy_subscription(self.subscription)

    class AsyncNode:
        """
        What listeners use of an AsyncNode, by the same signatures: no executor, no callback groups.

        It takes messages from the middleware itself, as the real one does, although it polls.
        """

        def __init__(self, node_name):
            self.inner = rclpy.create_node(node_name)
            self.entities = set()
            self.context = self.inner.context
            self._task = None

        async def __aenter__(self):
            self._task = asyncio.create_task(self._take())
            return self

        async def __aexit__(self, *exception):
            self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task
            for entity in list(self.entities):
                entity.destroy()
            self.inner.destroy_node()

        def get_name(self):
            return self.inner.get_name()

        def get_subscriber_names_and_types_by_node(self, node_name, namespace):
            return self.inner.get_subscriber_names_and_types_by_node(node_name, namespace)

        def create_subscription(
            self,
            msg_type,
            topic,
            callback,
            qos_profile,
            *,
            raw=False,
            concurrent=False,
            content_filter_options=None,
        ):
            inner = self.inner.create_subscription(msg_type, topic, callback, qos_profile, raw=raw)
            self.entities.add(made := AsyncSubscription(self, inner, callback))
            return made

        async def _take(self):
            while True:
                for entity in list(self.entities):
                    taken = entity.subscription
                    with taken.handle:
                        message = taken.handle.take_message(taken.msg_type, taken.raw)
                    if message is not None:
                        entity.callback(message[0])
                await asyncio.sleep(0.001)


__all__ = ["AsyncNode"]
