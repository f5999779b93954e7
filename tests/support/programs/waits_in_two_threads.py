"""Begins waits with a timeout in the main thread and in another one, until Ctrl-C."""

import threading
from contextlib import suppress

from rclpy.time import Time

from tf2_ros import Buffer

buffer, ending = Buffer(), threading.Event()


def work():
    while not ending.wait(0.001):
        buffer.wait_for_transform_async("map", "y", Time(seconds=1), timeout=0.01)


thread = threading.Thread(target=work)
thread.start()
with suppress(KeyboardInterrupt):
    print("ready", flush=True)
    while True:
        buffer.wait_for_transform_async("map", "x", Time(seconds=3), timeout=100.0)
ending.set()
