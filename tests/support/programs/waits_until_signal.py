# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Waits for a transform that is never inserted, until a signal; with the argument `await`, in asyncio."""

import asyncio
import sys
import threading

import rclpy
from rclpy.duration import Duration
from rclpy.time import Time

from tf2_ros import Buffer, TimeoutException


def report(buffer):
    while not buffer.statistics()["waiters"]:
        threading.Event().wait(0.001)
    print("waiting", flush=True)


def main(awaits):
    rclpy.init()
    buffer = Buffer()
    threading.Thread(target=report, args=(buffer,), daemon=True).start()
    if not awaits:
        buffer.lookup_transform("map", "robot", Time(), Duration(seconds=60))
    try:
        asyncio.run(buffer.lookup_transform_async("map", "robot", Time()))
    except TimeoutException as error:
        print(error, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] == ["await"])
