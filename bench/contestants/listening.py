"""
A node that listens to /tf, and measures what that costs and how soon a lookup has an answer. Its argument:

`listener`: a TransformListener as programs make it, which spins its node in a thread.
`executor`: the same, but every message and every transform passes through Python, as in upstream.
`spin_once`: a program that calls `spin_once` in a loop, and looks up in the buffer between.
`floor`: a thread without the GIL that takes the serialised messages and drops them.
"""

import os
import sys
import threading
import time

import rclpy
from rclpy.duration import Duration
from rclpy.time import Time
from serving import serve

from tf2_ros import Buffer, TransformListener

START_NS, STEP_NS = 10**12, 20 * 10**6  # as `publishing` stamps
TIMEOUT = Duration(seconds=10)
SETTLED_S = 0.2


class ThroughPython(TransformListener):
    """A listener with a callback of its own receives messages."""

    def callback(self, data):
        for transform in data.transforms:
            self.buffer.set_transform(transform, "default_authority")


class Looking:
    """Looks up in `buffer`, into which another process sends."""

    def order_look(self, first, count, how):
        """
        Look up the transform of each message before it arrives.

        :param how: `block` in a lookup with a timeout, or `poll` without end.
        :return: ns from the sending of each until the answer; messages that arrived before are left out.
        """
        answers = []
        for number in range(first, first + count):
            stamp = Time(nanoseconds=START_NS + number * STEP_NS)
            if self.buffer.can_transform_core("map", "f0", stamp)[0]:
                continue
            if how == "poll":
                while not self.buffer.can_transform_core("map", "f0", stamp)[0]:
                    continue
                now = time.monotonic()
                answer = self.buffer.lookup_transform("map", "f0", stamp)
            else:
                answer = self.buffer.lookup_transform("map", "f0", stamp, TIMEOUT)
                now = time.monotonic()
            answers.append(1e9 * (now - answer.transform.translation.x))
        return {"ns": answers}


class Listening(Looking):
    def __init__(self, path):
        rclpy.init()
        self._node = rclpy.create_node("bench_listening")
        self.buffer = Buffer()
        make = ThroughPython if path == "executor" else TransformListener
        self._listener = make(self.buffer, self._node, spin_thread=path != "spin_once")
        self._ending = threading.Event()
        self._spinning = threading.Thread(target=self._spin)
        if path == "spin_once":
            self._spinning.start()
        if path == "floor":
            # The receiver keeps no buffer alive, and without one drops what it takes. It would notice an
            # ordinary assignment.
            vars(self._listener)["buffer"] = self.buffer = None

    def end(self):
        """Leave the network: otherwise the publisher waits until this process counts as lost."""
        self._ending.set()
        if self._spinning.is_alive():
            self._spinning.join()
        self._listener.unregister()
        self._node.destroy_node()
        rclpy.shutdown()

    def _spin(self):
        while not self._ending.is_set():
            rclpy.spin_once(self._node, timeout_sec=0.1)
            self.buffer.can_transform_core("map", "f0", Time())

    def order_cost(self):
        """ns of CPU since the start: of the process, and of its threads by name."""
        threads = {}
        mine = {thread.native_id: thread.name for thread in threading.enumerate()}
        for task in os.listdir("/proc/self/task"):
            with (
                open(f"/proc/self/task/{task}/comm") as name,
                open(f"/proc/self/task/{task}/schedstat") as stat,
            ):
                name = mine.get(int(task), name.read().strip())
                threads[name] = threads.get(name, 0) + int(stat.read().split()[0])
        return {"cpu_ns": time.process_time_ns(), "threads": threads}

    def order_arrived(self, number):
        """Wait until message `number` has arrived; whether it has. Without a buffer nothing shows that."""
        if self.buffer is None:
            threading.Event().wait(SETTLED_S)
            return {"arrived": True}
        stamp = Time(nanoseconds=START_NS + number * STEP_NS)
        return {"arrived": self.buffer.can_transform("map", "f0", stamp, TIMEOUT)}


if __name__ == "__main__":
    listening = Listening(sys.argv[1])
    serve(listening, listening.end)
