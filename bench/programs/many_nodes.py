"""
Measure the CPU of many nodes while another process publishes.

`many_nodes.py KIND COUNT` is a process with so many nodes, which one executor spins. Beside them, it has:

`idle`: nothing.
`listening`: a buffer and a TransformListener.

It takes numbers of frames as lines of standard input, and answers each when its buffer has so many.
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
    def __init__(self, kind, count):
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        super().__init__([sys.executable, __file__, kind, str(count)], **pipes)

    def cpu_ns(self):
        """CPU since its start, in all its threads; the process does nothing for the answer."""
        return time.clock_gettime_ns(~self.pid << CLOCK_SHIFT | CLOCK_OF_SCHEDULER)


def many(rows, sizes, _, variant):
    """CPU seconds per second of nodes of one kind: one of them, all in processes of their own, or in one."""
    kind, processes, nodes = {
        "one": ("listening", 1, 1),
        "together": ("listening", 1, sizes.nodes),
    }.get(variant, (variant, sizes.nodes, 1))
    messages, started = round(RATE * sizes.receive_s), []
    try:
        started += [NodeProcess(kind, nodes) for _ in range(processes)]
        _await(started, 0)
        with Publisher("messages", processes if kind == "listening" else 0) as publisher:
            publisher.start(RATE, TRANSFORMS, sizes.filling)
            publisher.finish()
            _await(started, TRANSFORMS)
            before_ns, began_ns = sum(one.cpu_ns() for one in started), time.monotonic_ns()
            publisher.start(RATE, TRANSFORMS, messages)
            publisher.finish()
            used_ns, took_ns = sum(one.cpu_ns() for one in started), time.monotonic_ns() - began_ns
        rows.add(
            "listening, in one process" if variant == "together" else kind,
            {"nodes": processes * nodes},
            [(used_ns - before_ns) / took_ns],
            "CPU",
        )
    finally:
        for one in started:
            one.stdin.close()
        for one in started:
            one.wait()


def _await(processes, frames):
    for one in processes:
        one.stdin.write(f"{frames}\n")
        one.stdin.flush()
    for one in processes:
        if not one.stdout.readline():
            raise RuntimeError(f"a process has ended: {' '.join(one.args[2:])}")


def main(kind, count):
    rclpy.init()
    nodes = [rclpy.create_node(f"bench_{kind}_{os.getpid()}_{number}") for number in range(int(count))]
    buffer = Buffer()
    listeners = [TransformListener(buffer, nodes[0])] if kind == "listening" else []
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)

    def spin():
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    spinning = threading.Thread(target=spin)
    spinning.start()
    for line in sys.stdin:
        while listeners and len(buffer._getFrameStrings()) < int(line):
            threading.Event().wait(0.05)
        print("ready", flush=True)
    rclpy.shutdown()
    spinning.join()


if __name__ == "__main__":
    main(*sys.argv[1:])
