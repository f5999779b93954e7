# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Measure the CPU of many nodes while another process publishes.

`many_nodes.py COUNT` is a process with so many nodes, which one executor spins, and a buffer with a listener
for all of them. It takes numbers of frames as lines of standard input, and answers each when its buffer has
so many.
"""

import contextlib
import os
import subprocess
import sys
import threading
import time

import rclpy
from load_publisher import Publisher
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from tf2_ros import Buffer, TransformListener

TRANSFORMS, RATE = 50, 200  # in a message; messages a second
# What clock_getcpuclockid makes of the id of a process.
CLOCK_SHIFT, CLOCK_OF_SCHEDULER = 3, 2


class NodeProcess(subprocess.Popen):
    def __init__(self, count):
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        super().__init__([sys.executable, __file__, str(count)], **pipes)

    def cpu_ns(self):
        """CPU since its start, in all its threads; the process does nothing for the answer."""
        return time.clock_gettime_ns(~self.pid << CLOCK_SHIFT | CLOCK_OF_SCHEDULER)


def many(rows, sizes, _, variant):
    """CPU seconds per second of nodes: `together` in one process, or each `apart` in its own."""
    processes, nodes = (1, sizes.nodes) if variant == "together" else (sizes.nodes, 1)
    started = [NodeProcess(nodes) for _ in range(processes)]
    try:
        _await(started, 0)
        with Publisher(processes) as publisher:
            publisher.start(RATE, TRANSFORMS, sizes.filling)
            publisher.finish()
            _await(started, TRANSFORMS)
            before_ns, began_ns = sum(one.cpu_ns() for one in started), time.monotonic_ns()
            publisher.start(RATE, TRANSFORMS, round(RATE * sizes.receive_s))
            publisher.finish()
            used_ns, took_ns = sum(one.cpu_ns() for one in started), time.monotonic_ns() - began_ns
        rows.add(variant, {"nodes": sizes.nodes}, [(used_ns - before_ns) / took_ns], "CPU")
    finally:
        for one in started:
            one.communicate()


def _await(processes, frames):
    for one in processes:
        one.stdin.write(f"{frames}\n")
        one.stdin.flush()
    for one in processes:
        if not one.stdout.readline():
            raise RuntimeError("a process has ended")


def main(count):
    rclpy.init()
    nodes = [rclpy.create_node(f"bench_{os.getpid()}_{number}") for number in range(count)]
    buffer, executor = Buffer(), SingleThreadedExecutor()
    listener = TransformListener(buffer, nodes[0])
    for node in nodes:
        executor.add_node(node)

    def spin():
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    spinning = threading.Thread(target=spin)
    spinning.start()
    for line in sys.stdin:
        while len(buffer._getFrameStrings()) < int(line):
            threading.Event().wait(0.05)
        print("ready", flush=True)
    rclpy.shutdown()
    spinning.join()
    del listener


if __name__ == "__main__":
    main(int(sys.argv[1]))
