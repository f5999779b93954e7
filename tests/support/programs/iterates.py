"""Iterates over the messages of a filter that gets none, in asyncio, until the context is shut down."""

import asyncio

import rclpy

from tf2_ros import Buffer, MessageFilter


async def iterate(filter):
    asyncio.get_running_loop().call_later(0.1, lambda: print("waiting", flush=True))
    async for _ in filter:
        pass
    print("ended", flush=True)


if __name__ == "__main__":
    rclpy.init()
    node = rclpy.create_node("iterating")
    asyncio.run(iterate(MessageFilter(None, Buffer(), "map", 0, node=node)))
