"""Waits in one way, for whoever stops it meanwhile: `stops.py blocking|awaiting|receiving TIMEOUT`."""

import asyncio
import os
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import rclpy
from making import S, transform

from tf2_ros import Buffer, TransformException, TransformListener


def say_when_waiting(buffer):
    def say():
        while not buffer.statistics()["waiters"]:
            os.sched_yield()
        print("waiting", flush=True)
        if sys.stdin.readline() == "insert\n":
            buffer.set_transform(transform("map", "base", 1), "test")

    threading.Thread(target=say, daemon=True).start()


def blocking(buffer, timeout_s):
    return buffer.lookup_transform("map", "base", 1 * S, timeout_s)


def awaiting(buffer, timeout_s):
    return asyncio.run(buffer.lookup_transform_async("map", "base", 1 * S, timeout=timeout_s))


def receiving(buffer, timeout_s):
    """The number of frames, once `map` to `base` has data of 2 s."""
    buffer.lookup_transform("map", "base", 2 * S, timeout_s)
    buffer.lookup_transform("base", "camera", 0, timeout_s)
    return buffer.statistics()["frames"]


def main():
    way, timeout_s = globals()[sys.argv[1]], float(sys.argv[2])
    rclpy.init()
    buffer = Buffer()
    listener = None
    if way is receiving:
        node = rclpy.create_node("stops")
        listener = TransformListener(buffer, node)
    say_when_waiting(buffer)
    begin = time.monotonic()
    try:
        answer = way(buffer, timeout_s)
        outcome = answer if isinstance(answer, int) else answer.header.frame_id
    except TransformException as error:
        outcome = type(error).__name__
    waited_s = time.monotonic() - begin
    # Every lock is free: other threads insert, look up and wait.
    buffer.set_transform(transform("map", "after", 5), "test")
    assert buffer.can_transform("map", "after", 5 * S)
    buffer._self_check()
    assert buffer.statistics()["waiters"] == 0
    if listener is not None:
        listener.unregister()
    print(outcome, waited_s, max(0.0, waited_s - timeout_s), flush=True)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
