"""Owns what only this project is measured for: vector lookups, batches, waiters, threads, memory."""

import importlib.metadata
import pickle
import threading
import time
from time import perf_counter_ns

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rclpy.time import Time
from ros2_tf2 import Ros2, fill
from serving import AUTHORITY, STEP_NS, by_pair, rss_bytes, serve

from tf2_msgs.msg import TFMessage
from tf2_py import TransformException
from tf2_ros import Buffer, bag

BATCH = 50
FAR_NS = 3_600_000_000_000  # ahead of everything that is inserted
SETTLED = 10_000  # samples from which on fixed costs no longer show
START_NS = 1_700_000_000 * 10**9
ENDLESS = Duration(seconds=1e6)
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)

READ_TIMES = 1_000_000  # in one vector lookup of a reader
READ_NS = 90 * STEP_NS  # before the newest stamp
SLEEP_NS = 1_000_000
PAUSE_S = {"set_transform": 0.002, "lookup_transform": 0.0002}
QUIET_S = 0.5  # without a message, before no more are expected


class Ours(Ros2):
    def __init__(self):
        super().__init__()
        self.buffers = {}
        self.ending = threading.Event()
        self.threads = []
        self.read = 0
        self.late = []

    def about(self):
        version = importlib.metadata.version("tf2-ros-cython")
        return {"version": version, "returns": "geometry_msgs/TransformStamped"}

    def calls(self, way, queries):
        if way == "vector":
            calls = [(target, source, np.array(times)) for target, source, times in by_pair(queries)]
            return self.buffer.lookup_transforms, calls
        if way == "points":
            return self.buffer.transform_points, [
                (np.random.default_rng(1).uniform(-50, 50, (len(times), 3)), np.array(times), target, source)
                for target, source, times in by_pair(queries)
            ]
        if way == "can_transform_core":  # it returns why it is false
            function, calls = super().calls("core", queries)
            return self.buffer.can_transform_core, calls
        if way == "lookup_transform_core":
            function, calls = super().calls("core", queries)
            return failing(function), calls
        return super().calls(way, queries)

    def numbers(self, answer):
        if isinstance(answer, tuple):
            return (*answer[0][0], *answer[1][0])
        if isinstance(answer, np.ndarray):
            return answer[0]
        return super().numbers(answer)

    def inserts(self, way, transforms):
        if way == "set_transform":
            return super().inserts(way, transforms)
        messages = self.messages(transforms)
        size = 1 if way == "set_transforms_cdr of 1" else BATCH
        batches = [messages[i : i + size] for i in range(0, len(messages) - size + 1, size)]
        if way == "set_transforms":
            return self.buffer.set_transforms, [(batch, AUTHORITY) for batch in batches], size
        data = [bytes(serialize_message(TFMessage(transforms=batch))) for batch in batches]
        return self.buffer.set_transforms_cdr, [(message, AUTHORITY) for message in data], size

    def load_recording(self, path):
        self.buffer = bag.load(path, progress=False)

    def order_pickle(self, apart):
        """Time pickling and unpickling; `apart`: the arrays beside the pickle, and not in it."""
        arrays = []
        start = perf_counter_ns()
        data = pickle.dumps(self.buffer, protocol=5, buffer_callback=arrays.append if apart else None)
        copy = pickle.loads(data, buffers=arrays)
        end = perf_counter_ns()
        if copy.statistics()["samples"] != self.buffer.statistics()["samples"]:
            raise ValueError("the copy is another")
        return {"ns": end - start}

    def order_map_recordings(self, paths, target, source, out, workers):
        """Time a table of each recording, at 10 Hz."""
        start = perf_counter_ns()
        bag.map_recordings(paths, target, source, out, rate=10.0, workers=workers, progress=False)
        return {"ns": perf_counter_ns() - start}

    def order_threads(self, way, name, thread_count, call_count):
        """Wall time of so many calls in each of several threads."""
        began, ends = [], []
        work = [self.thread_calls(way, name, i, call_count) for i in range(thread_count)]
        begin = threading.Barrier(len(work), lambda: began.append(perf_counter_ns()))

        def run(function, calls):
            begin.wait()
            for arguments in calls:
                function(*arguments)
            ends.append(perf_counter_ns())

        threads = [threading.Thread(target=run, args=own) for own in work]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return {"ns": max(ends) - began[0]}

    def thread_calls(self, way, name, thread, count):
        if way == "set_transform":
            messages = [self.next_message(f"moving_{thread}") for _ in range(count)]
            return self.buffer.set_transform, [(message, AUTHORITY) for message in messages]
        function, calls = self.sets[way, name]
        return function, [calls[(thread + i) % len(calls)] for i in range(count)]

    def next_message(self, child):
        self.next_ns += STEP_NS
        return fill(TransformStamped(), child, "world", self.next_ns, POSE)

    def order_wait(self, what, count):
        """Make `count` futures that wait: for unknown frames, or for known ones later than any insert."""
        later = Time(nanoseconds=self.next_ns + FAR_NS)
        names = self.tree.names
        self.waiting = [
            self.buffer.wait_for_transform_async(
                names[0], f"nobody_{i}" if what == "unknown" else names[1 + i % (len(names) - 1)], later
            )
            for i in range(count)
        ]
        return {"pending": sum(not future.done() for future in self.waiting)}

    def order_stop_waiting(self):
        for future in self.waiting:
            future.cancel()
        self.waiting = []
        return {}

    def order_load_other(self):
        """Load the tree again: calls are timed on buffer `this`, the load is on this one or `other`."""
        self.buffers["other"] = self.buffer
        self.load(self.tree)
        self.buffers["this"] = self.buffer
        return {}

    def order_read(self, which, count):
        """Start threads in vector lookups that never pause."""
        buffer, names = self.buffers[which], self.tree.names
        times = self.tree.newest_ns - np.linspace(READ_NS, 0, READ_TIMES).astype(np.int64)
        begin = threading.Barrier(count + 1)

        def read():
            begin.wait()
            while not self.ending.is_set():
                buffer.lookup_transforms(names[0], names[-1], times)
                self.read += 1

        for _ in range(count):
            self.start(read)
        begin.wait()
        return {}

    def order_sleep(self):
        """Start a thread that sleeps again and again."""

        def sleep():
            while not self.ending.is_set():
                start = perf_counter_ns()
                time.sleep(SLEEP_NS / 1e9)
                self.late.append(perf_counter_ns() - start - SLEEP_NS)

        self.start(sleep)
        return {}

    def start(self, target):
        self.threads.append(threading.Thread(target=target))
        self.threads[-1].start()

    def order_stop(self):
        """End these threads; how many vector lookups they did, and by how many ns each sleep was late."""
        self.ending.set()
        for thread in self.threads:
            thread.join()
        answer = {"read": self.read, "late": self.late}
        self.ending, self.threads, self.read, self.late = threading.Event(), [], 0, []
        return answer

    def order_probe(self, way, seconds):
        """
        ns of each call, with pauses between them.

        Without pauses, a lock that is held for long would delay one call of very many.
        """
        names, stamp = self.tree.names, Time(nanoseconds=self.tree.newest_ns - READ_NS)
        function = getattr(self.buffer, way)
        times = []
        end_ns = perf_counter_ns() + int(seconds * 1e9)
        while perf_counter_ns() < end_ns:
            time.sleep(PAUSE_S[way])
            if way == "set_transform":
                arguments = self.next_message("moving"), AUTHORITY
            else:
                arguments = names[0], names[4], stamp
            start = perf_counter_ns()
            function(*arguments)
            times.append(perf_counter_ns() - start)
        return {"ns": times}

    def order_receive(self, which, depth):
        """Receive into a buffer, with a queue of that depth; how many transforms it has received before."""
        self.listen(self.buffers[which], qos=QoSProfile(depth=depth))
        return {"received": self.buffers[which].statistics()["taken"]}

    def order_received(self, which):
        """How many transforms a buffer has received when no more arrive."""
        received, before = self.buffers[which].statistics()["taken"], None
        while received != before:
            threading.Event().wait(QUIET_S)
            received, before = self.buffers[which].statistics()["taken"], received
        return {"received": received}

    def order_ring(self, count):
        """Bytes per sample that one ring accounts for while it fills, one by one: at worst and at best."""
        buffer = Buffer(ENDLESS)
        worst, best = (0.0, 0), (float("inf"), 0)  # bytes, samples
        for i, message in enumerate(self.serialised(count, 1), start=1):
            buffer.set_transforms_cdr(message, AUTHORITY)
            if i >= SETTLED:
                per_sample = buffer.statistics()["bytes"] / i
                worst, best = max(worst, (per_sample, i)), min(best, (per_sample, i))
        return {"worst": worst, "best": best}

    def order_resident(self, count):
        """Bytes per sample that the process holds at worst while one ring fills."""
        batch = 1000
        messages = self.serialised(count, batch)
        buffer = Buffer(ENDLESS)
        with open("/proc/self/clear_refs", "w") as file:
            file.write("5")  # reset the highest residence
        before = rss_bytes()
        worst = 0.0
        for i, message in enumerate(messages, start=1):
            buffer.set_transforms_cdr(message, AUTHORITY)
            if 2 * i >= len(messages):
                worst = max(worst, (highest_rss_bytes() - before) / (i * batch))
        return {"worst": worst}

    def serialised(self, count, batch):
        """Messages of `batch` transforms of one frame, 10 ms apart."""
        stamps = (START_NS + i * STEP_NS for i in range(count))
        messages = []
        message = TFMessage(transforms=[TransformStamped() for _ in range(batch)])
        for _ in range(count // batch):
            for transform in message.transforms:
                fill(transform, "ring", "world", next(stamps), POSE)
            messages.append(bytes(serialize_message(message)))
        return messages


def failing(function):
    """The same function, returning its exception."""

    def fail(*arguments):
        try:
            return function(*arguments)
        except TransformException as error:
            return error

    return fail


def highest_rss_bytes():
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) * 1024 for line in file if line.startswith("VmHWM"))


if __name__ == "__main__":
    ours = Ours()
    serve(ours, ours.end)
