"""
A node that reads, inserts and receives at once, and tells how long each was held up.

It has two buffers alike, `this` and `other`: what is timed is done to `this`, the load is put on one of them.
"""

import threading
import time
from time import perf_counter_ns

import numpy as np
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import QoSProfile
from rclpy.time import Time
from ros2_tf2 import AUTHORITY, S, fill
from serving import STEP_NS, serve

from tf2_ros import Buffer, TransformListener

START_NS = 1_700_000_000 * S
SAMPLES = 100
CHAIN = ["world", *(f"link_{i}" for i in range(1, 11))]
TARGET, SOURCE = CHAIN[0], CHAIN[4]  # of lookups; readers go up all of it
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
LONG, SHORT = 1_000_000, 10_000  # times in one vector lookup
INSERT_PERIOD_S = 0.002
SLEEP_S = 0.001
PROBE_PERIOD_S = 0.0002
SETTLED_S = 0.5


def filled():
    buffer = Buffer()
    for parent, child in zip(CHAIN, CHAIN[1:], strict=False):
        for i in range(SAMPLES):
            buffer.set_transform(
                fill(TransformStamped(), child, parent, START_NS + i * STEP_NS, POSE), AUTHORITY
            )
    return buffer


def sorted_times(count):
    return START_NS + np.linspace(0, (SAMPLES - 1) * STEP_NS, count).astype(np.int64)


class Loaded:
    def __init__(self):
        rclpy.init()
        self._node = rclpy.create_node("bench_loaded")
        self._buffers = {"this": filled(), "other": filled()}
        self._this = self._buffers["this"]
        self._listener = None
        self._ending = threading.Event()
        self._readers = []
        self._reads = []
        self._next_ns = START_NS

    def end(self):
        """Say good-bye: otherwise the publisher waits for this one for as long as it may be just silent."""
        self.order_deafen()
        self._node.destroy_node()
        rclpy.shutdown()

    def order_listen(self, which, depth):
        """Receive into a buffer, with a queue so deep; how many transforms it has taken so far."""
        self._listener = TransformListener(self._buffers[which], self._node, qos=QoSProfile(depth=int(depth)))
        return self.order_taken(which)

    def order_deafen(self):
        if self._listener is not None:
            self._listener.unregister()
            self._listener = None
        return {}

    def order_settle(self, which):
        """How many transforms a buffer has taken when no more arrive."""
        taken, before = self.order_taken(which), None
        while taken != before:
            threading.Event().wait(SETTLED_S)
            taken, before = self.order_taken(which), taken
        return taken

    def order_taken(self, which):
        return {"taken": self._buffers[which].statistics()["taken"]}

    def order_read(self, which, count):
        """Start threads in vector lookups that never pause."""
        self._ending.clear()
        self._reads.clear()
        begin = threading.Barrier(int(count) + 1)
        times = sorted_times(LONG)

        def read():
            begin.wait()
            while not self._ending.is_set():
                self._buffers[which].lookup_transforms(CHAIN[0], CHAIN[-1], times)
                self._reads.append(len(times))

        self._readers = [threading.Thread(target=read) for _ in range(int(count))]
        for thread in self._readers:
            thread.start()
        begin.wait()
        return {}

    def order_stop(self):
        """End the readers; how many transforms they have looked up."""
        self._ending.set()
        for thread in self._readers:
            thread.join()
        return {"read": sum(self._reads)}

    def order_insert(self, seconds):
        """ns of each insert, inside the call; by how many ns the short sleeps of another thread were late."""
        inserts, late, ended = [], [], threading.Event()

        def sleep():
            while not ended.is_set():
                start = perf_counter_ns()
                time.sleep(SLEEP_S)
                late.append(perf_counter_ns() - start - int(SLEEP_S * S))

        sleeping = threading.Thread(target=sleep)
        sleeping.start()
        end_ns = perf_counter_ns() + int(float(seconds) * S)
        while perf_counter_ns() < end_ns:
            time.sleep(INSERT_PERIOD_S)
            self._next_ns += STEP_NS
            message = fill(TransformStamped(), "moving", "world", self._next_ns, POSE)
            start = perf_counter_ns()
            self._this.set_transform(message, AUTHORITY)
            inserts.append(perf_counter_ns() - start)
        ended.set()
        sleeping.join()
        return {"inserts": inserts, "late": late}

    def order_look(self, seconds):
        """
        ns of each of many lookups, inside the call.

        They begin at times of their own: one after another, all that a lock holds up would be a single one.
        """
        stamp = Time(nanoseconds=START_NS + STEP_NS)
        lookups = []
        end_ns = perf_counter_ns() + int(float(seconds) * S)
        while perf_counter_ns() < end_ns:
            time.sleep(PROBE_PERIOD_S)
            start = perf_counter_ns()
            self._this.lookup_transform(TARGET, SOURCE, stamp)
            lookups.append(perf_counter_ns() - start)
        return {"lookups": lookups}

    def order_together(self, what, thread_count, call_count):
        """Wall time of calls in each of several threads, ns for each call of any of them."""
        began, ends = [], []
        calls = [self.calls(what, f"moving_{i}", int(call_count)) for i in range(int(thread_count))]
        begin = threading.Barrier(len(calls), lambda: began.append(perf_counter_ns()))

        def work(function, arguments_of_calls):
            begin.wait()
            for arguments in arguments_of_calls:
                function(*arguments)
            ends.append(perf_counter_ns())

        threads = [threading.Thread(target=work, args=own) for own in calls]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return {"ns": (max(ends) - began[0]) / (len(calls) * int(call_count))}

    def calls(self, what, child, count):
        """A function, and the arguments of so many calls; `child` is what it inserts."""
        if what == "lookup_transform":
            stamp = Time(nanoseconds=START_NS + STEP_NS // 2)
            return self._this.lookup_transform, [(TARGET, SOURCE, stamp)] * count
        if what == "lookup_transforms":
            return self._this.lookup_transforms, [(TARGET, SOURCE, sorted_times(SHORT))] * count
        self._next_ns += STEP_NS
        first_ns, self._next_ns = self._next_ns, self._next_ns + count * STEP_NS
        messages = [
            fill(TransformStamped(), child, "world", first_ns + i * STEP_NS, POSE) for i in range(count)
        ]
        return self._this.set_transform, [(message, AUTHORITY) for message in messages]


if __name__ == "__main__":
    loaded = Loaded()
    serve(loaded)
    loaded.end()
