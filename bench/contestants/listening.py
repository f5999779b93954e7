"""
A node that listens to /tf; what that costs, and how soon a lookup has an answer.

`listening.py PATH [COUNT [DEPTH]]` makes COUNT listeners with queues of that DEPTH, each with a buffer.

PATH is one of:

`listener`: TransformListeners as programs make them, under `rclpy.spin`.
`executor`: the same, but every message and every transform passes through Python, as in upstream.
`spin_once`: a program that calls `rclpy.spin_once` in a loop, and looks up in a buffer between.
`executor.spin_once`: the same with an executor of its own.
`floor`: the subscriptions only, under `rclpy.spin`; nobody ever takes a message from them.
"""

import contextlib
import ctypes
import queue
import sys
import threading
import time
from time import perf_counter_ns

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from ros2_tf2 import fill
from serving import AUTHORITY, serve, time_paced

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer, TransformListener

START_NS, STEP_NS = 10**12, 20 * 10**6  # as `publishing` stamps
NEVER = Time(nanoseconds=10**18)
TIMEOUT = Duration(seconds=10)
SETTLED_S = 0.2
QUIET_S = 0.5  # without a message, before no more are expected
DEPTH = 100  # of a listener's queues, where nothing else is wanted
PACE_S = 0.01
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)


class ThroughPython(TransformListener):
    """A listener with a callback of its own receives messages."""

    def callback(self, data):
        for transform in data.transforms:
            self.buffer.set_transform(transform, AUTHORITY)


class NeverGroup(CallbackGroup):
    """A group for which no executor waits: neither for its subscriptions, nor for their events."""

    def can_execute(self, entity):
        return False

    def beginning_execution(self, entity):
        return False

    def ending_execution(self, entity):
        pass


def subscribe_only(node):
    """What a listener subscribes to, without anyone who takes the messages."""
    lasting = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    for topic, qos in ("/tf", QoSProfile(depth=DEPTH)), ("/tf_static", lasting):
        node.create_subscription(TFMessage, topic, print, qos, callback_group=NeverGroup())


def settled_count(buffer):
    """How many transforms a buffer has received when no more arrive."""
    received, before = buffer.statistics()["taken"], None
    while received != before:
        threading.Event().wait(QUIET_S)
        received, before = buffer.statistics()["taken"], received
    return received


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
    def __init__(self, path, count="1", depth=None):
        rclpy.init()
        self._node = rclpy.create_node("bench_listening")
        self._buffers, self._listeners = [], []
        for _ in range(int(count)):
            if path == "floor":
                subscribe_only(self._node)
            else:
                make = ThroughPython if path == "executor" else TransformListener
                self._buffers.append(Buffer())
                qos = None if depth is None else QoSProfile(depth=int(depth))
                self._listeners.append(make(self._buffers[-1], self._node, qos=qos))
        self.buffer = self._buffers[0] if self._buffers else None
        self._waiting = None
        self._own_inserts = 0
        spin = {"spin_once": self._loop_spin_once, "executor.spin_once": self._loop_executor}
        self._ending = threading.Event()
        self._spinning = threading.Thread(target=spin.get(path, self._spin))
        self._spinning.start()

    def end(self):
        """Leave the network: otherwise the publisher waits until this process counts as lost."""
        self._ending.set()
        rclpy.shutdown()
        self._spinning.join()

    def _spin(self):
        with contextlib.suppress(ExternalShutdownException):
            rclpy.spin(self._node)

    def _loop_spin_once(self):
        self._loop(lambda: rclpy.spin_once(self._node, timeout_sec=0.1))

    def _loop_executor(self):
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        self._loop(lambda: executor.spin_once(timeout_sec=0.1))

    def _loop(self, spin_once):
        with contextlib.suppress(ExternalShutdownException):
            while not self._ending.is_set():
                spin_once()
                self.buffer.can_transform_core("map", "f0", Time())

    def order_cost(self):
        """ns of CPU of the process since its start."""
        return {"cpu_ns": time.process_time_ns()}

    def order_arrived(self, number):
        """Wait until message `number` has arrived; whether it has. Without a buffer nothing shows that."""
        if not self._buffers:
            threading.Event().wait(SETTLED_S)
        stamp = Time(nanoseconds=START_NS + number * STEP_NS)
        return {"arrived": all(buffer.can_transform("map", "f0", stamp, TIMEOUT) for buffer in self._buffers)}

    def order_received(self):
        """How many transforms have been received when no more arrive."""
        return {"received": settled_count(self.buffer)}

    def order_wait_for_ever(self):
        """Wait for a transform that never comes."""
        self._waiting = self.buffer.wait_for_transform_async("map", "f0", NEVER)
        return {}

    def order_stop_waiting(self):
        if self._waiting.done():
            return {"error": "the wait has ended by itself"}
        self._waiting.cancel()
        return {}

    def order_look_often(self, seconds, pace_s=PACE_S):
        """Time lookups of the newest transform, with pauses between them."""
        self.buffer.can_transform("map", "f0", Time(), TIMEOUT)
        calls = [("map", "f0", Time())] * max(1, round(seconds / pace_s))
        return {"ns": time_paced(self.buffer.lookup_transform, calls, pace_s)}

    def order_wake(self, count, pace_s):
        """
        Insert transforms that a lookup in another thread waits for, one at a time.

        :return: ns from the call of each insert until the lookup has returned.
        """
        stamps_ns = [START_NS + (self._own_inserts + i) * STEP_NS for i in range(count)]
        self._own_inserts += count
        returned = queue.SimpleQueue()

        def wait():
            for ns in stamps_ns:
                self.buffer.lookup_transform("map", "own", Time(nanoseconds=ns), TIMEOUT)
                returned.put(perf_counter_ns())

        waiting = threading.Thread(target=wait)
        waiting.start()
        answers = []
        for ns in stamps_ns:
            transform = fill(TransformStamped(), "own", "map", ns, POSE)
            time.sleep(pace_s)
            start = perf_counter_ns()
            self.buffer.set_transform(transform, AUTHORITY)
            answers.append(returned.get(timeout=TIMEOUT.nanoseconds / 1e9) - start)
        waiting.join()
        return {"ns": answers}

    def order_keep_busy(self, seconds):
        """Run a Python thread that gives the GIL up only where the interpreter demands it."""

        def work():
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                sum(range(1000))

        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        return {}

    def order_hold_gil(self, seconds):
        """Call C once, with the GIL."""
        ctypes.PyDLL(None).usleep(round(seconds * 1e6))
        return {}


if __name__ == "__main__":
    listening = Listening(*sys.argv[1:])
    serve(listening, listening.end)
