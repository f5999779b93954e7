"""Awaits a transform that is never inserted, in asyncio, until the context is shut down."""

import asyncio

import rclpy
from rclpy.time import Time

from tf2_ros import Buffer, TimeoutException


async def wait():
    buffer = Buffer()
    asyncio.get_running_loop().call_later(0.1, lambda: print("waiting", flush=True))
    try:
        await buffer.lookup_transform_async("map", "robot", Time())
    except TimeoutException as error:
        print(error, flush=True)


if __name__ == "__main__":
    rclpy.init()
    asyncio.run(wait())
