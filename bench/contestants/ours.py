"""Measure what only this project offers: vector lookups, batches, waiters, threads, memory, recordings."""

import importlib.metadata
import pickle
import threading
from time import perf_counter_ns

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from rclpy.time import Time
from ros2_tf2 import Ros2, fill
from serving import AUTHORITY, STEP_NS, by_pair, rss_bytes, serve

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer
from tf2_ros_tools import bag

BATCH = 50
FAR_NS = 3_600_000_000_000  # ahead of everything that is inserted
SETTLED = 10_000  # samples from which on fixed costs no longer show
START_NS = 1_700_000_000 * 10**9
ENDLESS = Duration(seconds=1e6)
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)


class Ours(Ros2):
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
        function, calls = self.sets[way, name]
        work = [[calls[(i + k) % len(calls)] for k in range(call_count)] for i in range(thread_count)]
        begin = threading.Barrier(len(work), lambda: began.append(perf_counter_ns()))

        def run(own):
            begin.wait()
            for arguments in own:
                function(*arguments)
            ends.append(perf_counter_ns())

        threads = [threading.Thread(target=run, args=(own,)) for own in work]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return {"ns": max(ends) - began[0]}

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


def highest_rss_bytes():
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) * 1024 for line in file if line.startswith("VmHWM"))


if __name__ == "__main__":
    ours = Ours()
    serve(ours, ours.end)
