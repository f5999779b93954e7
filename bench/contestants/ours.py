"""Owns the calls of this project that tf2 does not have: vector lookups, batches, waiters, memory."""

import importlib.metadata
import threading
from time import perf_counter_ns

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from rclpy.time import Time
from ros2_tf2 import AUTHORITY, Ros2, fill
from serving import STEP_NS, by_pair, rss_bytes, serve

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer

BATCH = 50
FAR_NS = 3_600_000_000_000  # ahead of everything that is inserted
SETTLED = 10_000  # samples from which on fixed costs no longer show
START_NS = 1_700_000_000 * 10**9
ENDLESS = Duration(seconds=1e6)


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
        messages = [fill(TransformStamped(), *transform) for transform in transforms]
        size = 1 if way == "set_transforms_cdr of 1" else BATCH
        batches = [messages[i : i + size] for i in range(0, len(messages) - size + 1, size)]
        if way == "set_transforms":
            return self.buffer.set_transforms, [(batch, AUTHORITY) for batch in batches], size
        data = [bytes(serialize_message(TFMessage(transforms=batch))) for batch in batches]
        return self.buffer.set_transforms_cdr, [(message, AUTHORITY) for message in data], size

    def order_threads(self, name, thread_count, call_count):
        """Wall time of `call_count` vector lookups in each of several threads."""
        function, calls = self.sets["vector", name]
        begin = threading.Barrier(int(thread_count) + 1)

        def work(offset):
            begin.wait()
            for i in range(int(call_count)):
                function(*calls[(offset + i) % len(calls)])

        threads = [threading.Thread(target=work, args=(i,)) for i in range(int(thread_count))]
        for thread in threads:
            thread.start()
        begin.wait()
        start = perf_counter_ns()
        for thread in threads:
            thread.join()
        return {"ns": perf_counter_ns() - start}

    def order_wait(self, what, count):
        """Have `count` futures pend: on frames nobody knows, or on known ones, later than any insert."""
        later = Time(nanoseconds=self.next_ns + FAR_NS)
        names = self.tree.names
        self.waiting = [
            self.buffer.wait_for_transform_async(
                names[0], f"nobody_{i}" if what == "unknown" else names[1 + i % (len(names) - 1)], later
            )
            for i in range(int(count))
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
        worst, best = (0.0, 0), (float("inf"), 0)
        for i, message in enumerate(self.serialised(int(count), 1), start=1):
            buffer.set_transforms_cdr(message, AUTHORITY)
            if i >= SETTLED:
                per_sample = buffer.statistics()["bytes"] / i
                worst, best = max(worst, (per_sample, i)), min(best, (per_sample, i))
        return {"worst": worst[0], "worst_at": worst[1], "best": best[0], "best_at": best[1]}

    def order_resident(self, count):
        """Bytes per sample that the process holds while one ring fills: at the end, and at worst."""
        batch = 1000
        messages = self.serialised(int(count), batch)
        buffer = Buffer(ENDLESS)
        with open("/proc/self/clear_refs", "w") as file:
            file.write("5")  # forget the highest residence so far
        before = rss_bytes()
        worst = 0.0
        for i, message in enumerate(messages, start=1):
            buffer.set_transforms_cdr(message, AUTHORITY)
            if 2 * i >= len(messages):
                worst = max(worst, (highest_rss_bytes() - before) / (i * batch))
        return {"held": (rss_bytes() - before) / (len(messages) * batch), "worst": worst}

    def serialised(self, count, batch):
        """Messages of `batch` transforms of one frame, 10 ms apart."""
        stamps = (START_NS + i * STEP_NS for i in range(count))
        pose = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
        messages = []
        message = TFMessage(transforms=[TransformStamped() for _ in range(batch)])
        for _ in range(count // batch):
            for transform in message.transforms:
                fill(transform, "ring", "world", next(stamps), pose)
            messages.append(bytes(serialize_message(message)))
        return messages


def highest_rss_bytes():
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) * 1024 for line in file if line.startswith("VmHWM"))


if __name__ == "__main__":
    serve(Ours())
