"""
A node that listens to /tf, and tells what that costs it and how soon it knows. Its argument is the road:

`listener`: a TransformListener as programs make it, which spins its node in a thread.
`executor`: the same, but every message and every transform through Python, as upstream does it.
`spin_once`: a program that calls `spin_once` again and again, and looks at the buffer between.
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

START_NS, STEP_NS = 10**12, 20 * 10**6  # as `flooding` stamps
PATIENCE = Duration(seconds=10)
SETTLED_S = 0.2


class ThroughPython(TransformListener):
    """That it has callbacks of its own is enough to get messages."""

    def callback(self, data):
        for transform in data.transforms:
            self.buffer.set_transform(transform, "default_authority")


class Listening:
    def __init__(self, road):
        rclpy.init()
        self._node = rclpy.create_node("bench_listening")
        self.buffer = Buffer()
        make = ThroughPython if road == "executor" else TransformListener
        self._listener = make(self.buffer, self._node, spin_thread=road != "spin_once")
        self._ending = threading.Event()
        self._spinning = threading.Thread(target=self._spin)
        if road == "spin_once":
            self._spinning.start()
        if road == "floor":
            # The receiver keeps no buffer alive, and without one drops what it takes. Not assigned, for the
            # receiver would notice.
            vars(self._listener)["buffer"] = self.buffer = None

    def end(self):
        """Say good-bye: otherwise the publisher waits for this one for as long as it may be just silent."""
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
        """ns of CPU so far: of the process, and of its threads by name."""
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

    def order_knows(self, number):
        """Wait until message `number` has come; whether it has."""
        stamp = Time(nanoseconds=START_NS + int(number) * STEP_NS)
        return {"knows": self.buffer.can_transform("map", "f0", stamp, PATIENCE)}

    def order_settle(self):
        """Where nobody can tell what has come."""
        threading.Event().wait(SETTLED_S)
        return {}

    def order_look(self, first, count, how):
        """
        Look up the transform of each message before it comes.

        :param how: `block` in a lookup with a timeout, or `poll` without end.
        :return: seconds from the sending of each until the answer; some may have come too early.
        """
        answers, early = [], 0
        for number in range(int(first), int(first) + int(count)):
            stamp = Time(nanoseconds=START_NS + number * STEP_NS)
            if self.buffer.can_transform_core("map", "f0", stamp)[0]:
                early += 1
                continue
            if how == "poll":
                while not self.buffer.can_transform_core("map", "f0", stamp)[0]:
                    continue
                now = time.monotonic()
                answer = self.buffer.lookup_transform("map", "f0", stamp)
            else:
                answer = self.buffer.lookup_transform("map", "f0", stamp, PATIENCE)
                now = time.monotonic()
            answers.append(now - answer.transform.translation.x)
        return {"s": answers, "early": early}


if __name__ == "__main__":
    listening = Listening(sys.argv[1])
    serve(listening)
    listening.end()
