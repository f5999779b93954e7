"""Owns inserts beside waiters that they do not answer: every kind of waiter, every kind of insert."""

import itertools

from geometry_msgs.msg import TransformStamped
from rclpy.time import Time
from ros2_tf2 import S, fill
from serving import AUTHORITY, STEP_NS, serve, time_calls

from tf2_py import BufferCore

START_NS = 1_700_000_000 * S
FAR_NS = 3600 * S  # from anything that is inserted
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
TURNS = 5

NOW, LATEST = Time(nanoseconds=START_NS), Time()
LINKS = [
    ("map", "base"), ("map", "other"), ("sea", "island"), ("arm", "hand"), ("table", "cup"),
    ("table", "ball"), ("map", "gate"),
]  # fmt: skip
NEW_PARENTS = [("hand", "cup"), ("hand", "ball")]
LOOP = [("ring", "chain"), ("chain", "ring")]
NEW_FRAMES = itertools.count()


def after(ns):
    return Time(nanoseconds=START_NS + ns)


# The arguments of waiter i: target, source and time, or two times.
WAITERS = {
    "later": lambda i: ("map", "base", after(FAR_NS + i)),
    "earlier": lambda i: ("map", "base", after(i - FAR_NS)),
    "unknown target": lambda i: (f"nobody_{i}", "base", NOW),
    "unknown source": lambda i: ("base", f"nobody_{i}", NOW),
    "latest, unconnected": lambda i: ("island", "base", LATEST),
    # The cup has moved to the hand, but the hand has no sample since then.
    "latest, new parent": lambda i: ("arm", "cup", LATEST),
    "two times": lambda i: ("map", "base", after(FAR_NS + i), "map", LATEST),
    "a time, unconnected": lambda i: ("island", "base", NOW),
    "later, in a loop": lambda i: ("map", "base", after(FAR_NS + i)),
}
# The link, parent and child, of insert i; `kind` is what the waiters wait for.
INTO = {
    "own frame": lambda kind, i: ("hand", "cup") if kind == "latest, new parent" else ("map", "base"),
    "other frame": lambda kind, i: ("map", "other"),
    "two parents": lambda kind, i: ("hand", "cup"),
    "alternating": lambda kind, i: (("hand", "table")[i % 2], "ball"),
    "new frame": lambda kind, i: ("map", f"new_{next(NEW_FRAMES)}"),
    "static or not": lambda kind, i: ("map", "gate"),
}


def message(link, stamp_ns):
    parent, child = link
    return fill(TransformStamped(), child, parent, stamp_ns, POSE)


class Waiting:
    def __init__(self):
        self.alone = self.beside = None
        self.waiting = []
        self.next_ns = 0

    def order_kinds(self):
        return {"waiting_for": list(WAITERS), "into": list(INTO)}

    def order_prepare(self, kind, count):
        """Two equal buffers, one of them with waiters; how many pend."""
        self.alone, self.beside = filled(kind), filled(kind)
        self.next_ns = START_NS + 3 * STEP_NS
        self.waiting = [self.beside._wait(*WAITERS[kind](i), notify=print) for i in range(count)]
        return {"pending": self.beside.statistics()["waiters"]}

    def order_insert(self, kind, into, count, budget_s):
        """
        Time inserts of one kind into one buffer and the other, in turn.

        :return: ns of each insert beside none and beside the waiters, and how many wait afterwards.
        """
        times = {"alone": [], "beside": []}
        failed = 0
        for turn in range(TURNS + 1):
            links = [INTO[into](kind, i) for i in range(count // TURNS)]
            messages = [message(link, self.next_ns + i) for i, link in enumerate(links)]
            self.next_ns += count
            for name, buffer in ("alone", self.alone), ("beside", self.beside):
                if into == "static or not":
                    function = buffer.set_transforms
                    calls = [([each], AUTHORITY, i % 2 == 0) for i, each in enumerate(messages)]
                else:
                    function, calls = buffer.set_transform, [(each, AUTHORITY) for each in messages]
                budget = budget_s / TURNS
                taken, refused, empty_ns = time_calls(function, calls, len(calls), budget, must_answer=False)
                failed += refused
                if turn:  # the first one is to warm up
                    times[name] += taken
        pending = self.beside.statistics()["waiters"]
        return {**times, "failed": failed, "empty_ns": empty_ns, "pending": pending}


def filled(kind):
    buffer = BufferCore()
    stamped = [(link, i) for i in range(2) for link in LINKS]
    stamped += [(link, 2) for link in NEW_PARENTS + (LOOP if kind.endswith("loop") else [])]
    for link, i in stamped:
        buffer.set_transform(message(link, START_NS + i * STEP_NS), AUTHORITY)
    return buffer


if __name__ == "__main__":
    serve(Waiting())
