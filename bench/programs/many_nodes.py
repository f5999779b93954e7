"""
Measure the CPU of many nodes while another process publishes.

`many_nodes.py KIND NAME` is one of them: a node that is spun, and what it has beside:

`idle`: nothing.
`listening`: a buffer and a TransformListener.
`attached`: the same; the environment has it attach the shared buffer of that name.
`looking`: the same, and it looks a transform up ten times a second.
`owner`: a buffer that it shares by that name, and a TransformListener.

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
from rclpy.executors import ExternalShutdownException

from tf2_ros import Buffer, TransformListener

TRANSFORMS, RATE = 50, 200  # in a message; messages a second
BY_OWNER = ("attached", "looking")
# What clock_getcpuclockid makes of the id of a process.
CLOCK_SHIFT, CLOCK_OF_SCHEDULER = 3, 2


class NodeProcess(subprocess.Popen):
    def __init__(self, kind, name):
        environment = os.environ | ({"TF2_SHARED_BUFFER": name} if kind in BY_OWNER else {})
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        super().__init__([sys.executable, __file__, kind, name], env=environment, **pipes)

    def cpu_ns(self):
        """CPU since its start, in all its threads; the process does nothing for the answer."""
        return time.clock_gettime_ns(~self.pid << CLOCK_SHIFT | CLOCK_OF_SCHEDULER)


def many(rows, sizes, _, variant):
    """CPU seconds per second of nodes of one kind together; of attached ones and their owner."""
    kind, count = ("listening", 1) if variant == "one" else (variant, sizes.nodes)
    name, messages = f"bench-nodes-{os.getpid()}", round(RATE * sizes.receive_s)
    nodes = []
    try:
        # An owner is there before the others look for it.
        for some in [["owner"]] * (kind in BY_OWNER) + [[kind] * count]:
            started = [NodeProcess(kind_of_one, name) for kind_of_one in some]
            nodes += started
            _await(started, 0)
        listeners = {"idle": 0, "listening": count}.get(kind, 1)
        with Publisher("messages", listeners) as publisher:
            publisher.start(RATE, TRANSFORMS, sizes.filling)
            publisher.finish()
            _await(nodes, TRANSFORMS)
            before_ns, began_ns = sum(node.cpu_ns() for node in nodes), time.monotonic_ns()
            publisher.start(RATE, TRANSFORMS, messages)
            publisher.finish()
            used_ns, took_ns = sum(node.cpu_ns() for node in nodes), time.monotonic_ns() - began_ns
        rows.add(kind, {"nodes": count}, [(used_ns - before_ns) / took_ns], "CPU")
    finally:
        for node in nodes:
            node.stdin.close()
        for node in nodes:
            node.wait()


def _await(nodes, frames):
    for node in nodes:
        node.stdin.write(f"{frames}\n")
        node.stdin.flush()
    for node in nodes:
        if not node.stdout.readline():
            raise RuntimeError(f"a node has ended: {' '.join(node.args[2:])}")


def main(kind, name):
    rclpy.init()
    node = rclpy.create_node(f"bench_{kind}_{os.getpid()}")
    buffer = None
    if kind != "idle":
        buffer = Buffer(share=name) if kind == "owner" else Buffer()
        listener = TransformListener(buffer, node)
        assert (buffer._tf2_attachment is not None) == (kind in BY_OWNER), listener

    def spin():
        with contextlib.suppress(ExternalShutdownException):
            rclpy.spin(node)

    spinning = threading.Thread(target=spin)
    spinning.start()
    ended = threading.Event()
    if kind == "looking":
        threading.Thread(target=_look, args=(buffer, ended), daemon=True).start()
    for line in sys.stdin:
        while buffer is not None and len(buffer._getFrameStrings()) < int(line):
            threading.Event().wait(0.05)
        print("ready", flush=True)
    ended.set()
    rclpy.shutdown()
    spinning.join()


def _look(buffer, ended):
    names = []
    while not ended.wait(0.1):
        names = names or buffer._getFrameStrings()
        if names:
            buffer.can_transform_core(names[0], names[-1], 0)


if __name__ == "__main__":
    main(*sys.argv[1:])
