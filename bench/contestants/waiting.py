"""Owns inserts beside waiters that they do not answer: every kind of waiter, every kind of insert."""

import itertools

from geometry_msgs.msg import TransformStamped
from rclpy.time import Time
from ros2_tf2 import AUTHORITY, S, fill
from serving import STEP_NS, serve, time_calls

from tf2_py import BufferCore

START_NS = 1_700_000_000 * S
FAR_NS = 3600 * S  # from anything that is inserted
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
TURNS = 5


def message(parent, child, stamp_ns):
    return fill(TransformStamped(), child, parent, stamp_ns, POSE)


def later(i):
    return "map", "base", Time(nanoseconds=START_NS + FAR_NS + i)


def earlier(i):
    return "map", "base", Time(nanoseconds=START_NS - FAR_NS + i)


def unknown_target(i):
    return f"nobody_{i}", "base", Time(nanoseconds=START_NS)


def unknown_source(i):
    return "base", f"nobody_{i}", Time(nanoseconds=START_NS)


def latest_unconnected(i):
    return "island", "base", Time()


def latest_new_parent(i):
    # Grasped, but the arm has not told since where the hand is.
    return "arm", "cup", Time()


def two_times(i):
    return "map", "base", Time(nanoseconds=START_NS + FAR_NS + i), "map", Time()


def unconnected(i):
    return "island", "base", Time(nanoseconds=START_NS)


# What each waits for, and the link that it waits for: parent and child.
WAITERS = {
    "later": (later, ("map", "base")),
    "earlier": (earlier, ("map", "base")),
    "unknown target": (unknown_target, ("map", "base")),
    "unknown source": (unknown_source, ("map", "base")),
    "latest, unconnected": (latest_unconnected, ("map", "base")),
    "latest, new parent": (latest_new_parent, ("hand", "cup")),
    "two times": (two_times, ("map", "base")),
    "a time, unconnected": (unconnected, ("map", "base")),
    "later, in a loop": (later, ("map", "base")),
}
NEW = itertools.count()


class Waiting:
    def __init__(self):
        self.alone = self.beside = None
        self.waiting = []
        self.next_ns = 0

    def order_prepare(self, what, count):
        """Two buffers alike, but that so many wait in one of them; how many pend."""
        self.waiting = []
        self.alone, self.beside = filled(what), filled(what)
        self.next_ns = START_NS + 3 * STEP_NS
        lookup, _ = WAITERS[what]
        for i in range(int(count)):
            target, source, time, *rest = lookup(i)
            self.waiting.append(self.beside._wait(target, source, time, *rest, notify=print))
        return {"pending": self.beside.statistics()["waiters"]}

    def order_insert(self, what, into, count, budget_s):
        """
        Time inserts of one kind into one buffer and the other, in turn.

        :return: ns of each insert beside none and beside the waiters, and how many wait afterwards.
        """
        alone, beside, empty_ns = [], [], 0
        for turn in range(TURNS + 1):
            first_ns, first = self.next_ns, next(NEW) * int(count)
            self.next_ns += int(count)
            for buffer, taken in (self.alone, alone), (self.beside, beside):
                function, calls = inserts(buffer, what, into, first_ns, first, int(count) // TURNS)
                budget = float(budget_s) / TURNS
                times, _, empty_ns = time_calls(function, calls, len(calls), budget, must_answer=False)
                if turn:  # the first one is to warm up
                    taken += times
        pending = self.beside.statistics()["waiters"]
        return {"alone": alone, "beside": beside, "empty_ns": empty_ns, "pending": pending}


def filled(what):
    buffer = BufferCore()
    links = [
        ("map", "base"), ("map", "other"), ("sea", "island"), ("arm", "hand"), ("table", "cup"),
        ("table", "ball"), ("map", "gate"),
    ]  # fmt: skip
    for i in range(2):
        for link in links:
            buffer.set_transform(message(*link, START_NS + i * STEP_NS), AUTHORITY)
    regrasped = [("hand", "cup"), ("hand", "ball")]
    ring = [("ring", "chain"), ("chain", "ring")] if what.endswith("loop") else []
    for link in regrasped + ring:
        buffer.set_transform(message(*link, START_NS + 2 * STEP_NS), AUTHORITY)
    return buffer


def inserts(buffer, what, into, first_ns, first, count):
    """A function of the buffer, and the arguments of each call."""
    links = {
        "own frame": lambda i: WAITERS[what][1],
        "other frame": lambda i: ("map", "other"),
        "two parents": lambda i: ("hand", "cup"),
        "alternating": lambda i: (("hand", "table")[i % 2], "ball"),
        "new frame": lambda i: ("map", f"new_{first + i}"),
        "static or not": lambda i: ("map", "gate"),
    }
    messages = [message(*links[into](i), first_ns + i) for i in range(count)]
    if into == "static or not":
        return buffer.set_transforms, [([each], AUTHORITY, i % 2 == 0) for i, each in enumerate(messages)]
    return buffer.set_transform, [(each, AUTHORITY) for each in messages]


if __name__ == "__main__":
    serve(Waiting())
