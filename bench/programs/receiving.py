"""Measure nodes that listen to /tf: CPU, lookups and waits beside messages, messages lost."""

import contextlib
import ctypes
import itertools
import queue
import threading
import time
from time import perf_counter_ns

import numpy as np
import rclpy
from geometry_msgs.msg import TransformStamped
from load_publisher import DEPTH, Publisher, online_tree, stamp_ns
from measured_library import AUTHORITY, time_paced
from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from tf2_python import S, fill

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer, TransformListener

LOADS = ((50, 200), (1, 500))  # transforms in a message, messages a second
NEVER = Time(nanoseconds=10**18)
TIMEOUT = Duration(seconds=60)
QUIET_S = 0.5  # without a message, before no more are expected
PACE_S = 0.01
WAKE_RATE = 100
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
PAIRS = 100
AGE_S = 0.5  # of the times that are looked up online
ONLINE_BATCH, ONLINE_PAUSE_S = 25, 0.025  # 1,000 lookups a second
HISTORY_S = 0.8  # to look up in


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


class Listening:
    """
    A node with `count` listeners, each with a buffer, and a thread that spins it.

    :param kind: `listener`; `overridden`: ThroughPython; `floor`: the same subscriptions, from which nobody
        ever takes a message. `spin_once`, `executor.spin_once`: as `listener`, but the thread calls this in
        a loop, without and with a timeout; `spin_once+lookup`: it also looks a frame up in each turn.
    """

    def __init__(self, kind="listener", count=1, depth=DEPTH):
        rclpy.init()
        self.node = rclpy.create_node("bench_listening")
        self.buffers = [] if kind == "floor" else [Buffer() for _ in range(count)]
        make = ThroughPython if kind == "overridden" else TransformListener
        options = {} if depth == DEPTH else {"qos": QoSProfile(depth=depth)}
        self._listeners = [make(buffer, self.node, **options) for buffer in self.buffers]
        if kind == "floor":
            self._subscribe(count)
        self._thread = threading.Thread(target=self._run, args=(kind,))
        self._thread.start()

    def _subscribe(self, count):
        lasting = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for topic, qos in (("/tf", QoSProfile(depth=DEPTH)), ("/tf_static", lasting)) * count:
            self.node.create_subscription(TFMessage, topic, print, qos, callback_group=NeverGroup())

    def _run(self, kind):
        with contextlib.suppress(ExternalShutdownException):
            if "spin_once" in kind:
                self._spin_in_loop(kind)
            else:
                rclpy.spin(self.node)

    def _spin_in_loop(self, kind):
        executor = SingleThreadedExecutor() if kind == "executor.spin_once" else None
        if executor is not None:
            executor.add_node(self.node)
        while rclpy.ok():
            if executor is not None:
                executor.spin_once(timeout_sec=0.1)
            else:
                rclpy.spin_once(self.node)
            if kind == "spin_once+lookup":
                self.buffer.can_transform("map", "f0", Time())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        rclpy.shutdown()
        self._thread.join()

    @property
    def buffer(self):
        return self.buffers[0]

    def receive(self, publisher, rate, transforms, messages):
        """Have messages published, and wait until every buffer has the last one."""
        first = publisher.start(rate, transforms, messages)
        publisher.finish()
        last = Time(nanoseconds=stamp_ns(first + messages - 1))
        if not self.buffers:
            threading.Event().wait(QUIET_S)
        for buffer in self.buffers:
            if not buffer.can_transform("map", "f0", last, TIMEOUT):
                raise RuntimeError(f"the last of {messages} messages did not arrive")


def cpu(rows, sizes, _, variant):
    """CPU of a process per message that it receives while nobody else looks."""
    kind, count = variant.split()
    with Listening(kind, int(count)) as listening, Publisher("messages", int(count)) as publisher:
        # The largest messages first: every frame has a full history then.
        listening.receive(publisher, *reversed(LOADS[0]), sizes.filling)
        for transforms, rate in LOADS:
            messages = round(rate * sizes.receive_s)
            before_ns = time.process_time_ns()
            listening.receive(publisher, rate, transforms, messages)
            labels = {"transforms": transforms, "Hz": rate, "listeners": int(count)}
            rows.add(kind, labels, [(time.process_time_ns() - before_ns) / messages])


def lookups(rows, sizes, _, variant):
    """Lookups 100 times a second: they insert what has arrived, or a pending wait has had it inserted."""
    transforms, rate = LOADS[0]
    with Listening() as listening, Publisher("messages", 1) as publisher:
        buffer = listening.buffer
        listening.receive(publisher, rate, transforms, sizes.filling)
        waiting = buffer.wait_for_transform_async("map", "f0", NEVER) if variant == "a pending wait" else None
        publisher.start(rate, transforms, 10**9)
        times = time_paced(buffer.lookup_transform, [("map", "f0", Time())] * sizes.paced, PACE_S)
        if waiting is not None:
            waiting.cancel()
        rows.add(variant, {"transforms": transforms, "Hz": rate}, times)
        rows.add(f"{variant}, p99", {"transforms": transforms, "Hz": rate}, [np.percentile(times, 99)])


def waits(rows, sizes, _, variant):
    """How soon a waiting lookup returns: from an insert in its process, from sending in another."""
    with Listening() as listening, Publisher("messages", 1) as publisher:
        listening.receive(publisher, WAKE_RATE, 1, 1)
        if variant == "own insert":
            times = _wake(listening.buffer, sizes.wakes)
        else:
            first = publisher.start(WAKE_RATE, 1, sizes.wakes)
            times = look(listening.buffer, range(first, first + sizes.wakes), variant)
            publisher.finish()
        rows.add(variant, {"Hz": WAKE_RATE}, times)


def look(buffer, numbers, variant=""):
    """ns from the sending of each message until a lookup of its transform, which began before, returns."""
    answers = []
    for number in numbers:
        stamp = Time(nanoseconds=stamp_ns(number))
        if buffer.can_transform_core("map", "f0", stamp)[0]:
            continue
        while variant == "polls" and not buffer.can_transform_core("map", "f0", stamp)[0]:
            continue
        answer = buffer.lookup_transform("map", "f0", stamp, TIMEOUT)
        answers.append(1e9 * (time.monotonic() - answer.transform.translation.x))
    return answers


def _wake(buffer, count):
    """ns from the call of an insert until the lookup in another thread that waits for it has returned."""
    stamps_ns = [stamp_ns(i) for i in range(count)]
    returned = queue.SimpleQueue()

    def wait():
        for ns in stamps_ns:
            buffer.lookup_transform("map", "own", Time(nanoseconds=ns), TIMEOUT)
            returned.put(perf_counter_ns())

    waiting = threading.Thread(target=wait)
    waiting.start()
    answers = []
    for ns in stamps_ns:
        transform = fill(TransformStamped(), "own", "map", ns, POSE)
        time.sleep(1 / WAKE_RATE)
        start = perf_counter_ns()
        buffer.set_transform(transform, AUTHORITY)
        answers.append(returned.get(timeout=TIMEOUT.nanoseconds / S) - start)
    waiting.join()
    return answers


def losses(rows, sizes, _, variant):
    """Messages that a buffer never got, of many, or of those that arrive while Python cannot run."""
    transforms = LOADS[0][0]
    # Messages a second, how many fit into the queues, for how long, and what is done meanwhile.
    rate, depth, seconds, act = {
        "lookups": (2000, 2000, sizes.flood_s, _look_often),
        "busy thread": (2000, 2000, sizes.flood_s, _keep_busy),
        "no reader": (2000, 2000, sizes.unread_s, None),
        "held GIL": (200, DEPTH, sizes.held_s, _hold_gil),
    }[variant]
    messages = round(rate * seconds)
    with Listening(depth=depth) as listening, Publisher("messages", 1, depth) as publisher:
        publisher.start(rate, transforms, messages)
        if act is not None:
            act(listening.buffer, seconds)
        sent_s = publisher.finish()
        received, before = listening.buffer.statistics()["taken"], None
        while received != before:
            threading.Event().wait(QUIET_S)
            received, before = listening.buffer.statistics()["taken"], received
    labels = {"Hz": rate, "messages in the queue": depth, "beside": variant}
    rows.add("lost", labels, [messages - received / transforms], "messages")
    # A busy machine may not send as many a second as are wanted.
    rows.add("sent", labels, [messages / sent_s], "/s")


def _look_often(buffer, seconds):
    buffer.can_transform("map", "f0", Time(), TIMEOUT)
    time_paced(buffer.lookup_transform, [("map", "f0", Time())] * round(seconds / PACE_S), PACE_S)


def _keep_busy(_, seconds):
    """Run a Python thread that gives the GIL up only where the interpreter demands it."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        sum(range(1000))


def _hold_gil(_, seconds):
    ctypes.PyDLL(None).usleep(round(seconds * 1e6))


def online(rows, sizes, _):
    """The online scenario of the published evaluation: lookups while another process publishes a tree."""
    tree = online_tree(sizes.online_frames)
    rclpy.init()
    node = rclpy.create_node("bench_online")
    buffer = Buffer(Duration(nanoseconds=tree.cache_ns))
    listener = TransformListener(buffer, node, spin_thread=True)
    with Publisher("tree", sizes.online_frames):
        while len(buffer._getFrameStrings()) < len(tree.names):
            threading.Event().wait(0.05)
        threading.Event().wait(HISTORY_S)
        for hops in (1, 4, 10):
            labels = {"tree": tree.name, "place": "past", "hops": hops}
            pairs = tree.pairs(hops, PAIRS)
            round_and_round = itertools.cycle([(tree.names[a], tree.names[b]) for a, b in pairs])
            times, before_ns, end = [], time.process_time_ns(), time.monotonic() + sizes.online_s
            while time.monotonic() < end:
                time.sleep(ONLINE_PAUSE_S)
                past = Time(nanoseconds=time.time_ns() - int(AGE_S * S))
                calls = [(*pair, past) for pair in itertools.islice(round_and_round, ONLINE_BATCH)]
                times += time_paced(buffer.lookup_transform, calls)
            cpu_s = (time.process_time_ns() - before_ns) / S
            rows.add("buffer", labels, times)
            rows.add("p99", labels, [np.percentile(times, 99)])
            rows.add("CPU", labels, [cpu_s / sizes.online_s], "CPU")
    listener.unregister()
    rclpy.shutdown()
