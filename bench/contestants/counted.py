"""Count the instructions of calls; `python counted.py CASE...` runs them between marks."""

import functools
import gc
import os
import sys

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from rclpy.time import Time
from ros2_tf2 import fill
from serving import AUTHORITY, STEP_NS

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer

START_NS = 1_700_000_000 * 10**9
SINGLE, BATCHED = 200, 10  # calls of the shorter run: of what handles one transform, and of what handles many
VECTOR_TIMES = 1000
WARM_UP = 20
BATCH = 50
HOPS = 4
SAMPLES = 300  # per frame


def pose(i):
    angle = 0.001 * i
    return 1.0 + angle, 2.0, 3.0, 0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)


@functools.cache
def chain(samples, full=False):
    """
    A buffer with a chain of moving frames; samples 0: one static link each.

    `full`: every further sample drops the oldest.
    """
    buffer = Buffer(Duration(nanoseconds=samples * STEP_NS) if full else Duration(seconds=1e6))
    frames = range(HOPS)
    batch = TFMessage(transforms=[TransformStamped() for _ in frames])
    for i in range(samples or 1):
        for message, frame in zip(batch.transforms, frames, strict=True):
            fill(message, f"frame_{frame + 1}", f"frame_{frame}", START_NS + i * STEP_NS, pose(i + frame))
        buffer.set_transforms_cdr(bytes(serialize_message(batch)), AUTHORITY, samples == 0)
    return buffer


def past(i):
    """A time within the history, in another interval than the one before it."""
    return START_NS + (i * 7919 % ((SAMPLES - 1) * STEP_NS // 1000)) * 1000


def lookups(buffer, count, time_of):
    return buffer.lookup_transform, [
        ("frame_0", f"frame_{HOPS}", Time(nanoseconds=time_of(i))) for i in range(count)
    ]


def vector(buffer, count):
    times = np.array(sorted(past(104729 * i) for i in range(VECTOR_TIMES)))
    return buffer.lookup_transforms, [("frame_0", f"frame_{HOPS}", times)] * count


def next_messages(samples, count, per_message):
    """Messages that continue the history of a chain."""
    for i in range(count):
        yield [
            fill(
                TransformStamped(),
                "frame_1",
                "frame_0",
                START_NS + (samples + i * per_message + k) * STEP_NS,
                pose(k),
            )
            for k in range(per_message)
        ]


class Point:
    def __init__(self, x, name):
        self.x = x
        self.name = name


def reference(table, name, x):
    """What Python itself costs here: calls, a dict, attributes, floats, small objects."""
    total = x
    for k in range(10):
        point = Point(total + k, name)
        table[name] = point.x * 0.5
        total = table[name] + point.x
    return total


def case(name, count):
    """A function and `count` argument tuples."""
    if name == "reference":
        return reference, [({}, "frame", float(i)) for i in range(count)]
    if name == "Buffer.lookup_transform static":
        return lookups(chain(0), count, lambda i: 0)
    if name == "Buffer.lookup_transform latest":
        return lookups(chain(SAMPLES), count, lambda i: 0)
    if name == "Buffer.lookup_transform past":
        return lookups(chain(SAMPLES), count, lambda i: past(104729 * i))
    if name == "lookup_transforms":
        return vector(chain(SAMPLES), count)
    if name == "set_transform":
        return chain(SAMPLES, full=True).set_transform, [
            (message, AUTHORITY) for (message,) in next_messages(SAMPLES, count, 1)
        ]
    if name == "set_transforms_cdr":
        data = [
            bytes(serialize_message(TFMessage(transforms=batch)))
            for batch in next_messages(SAMPLES + 1000, count, BATCH)
        ]
        return chain(SAMPLES, full=True).set_transforms_cdr, [(message, AUTHORITY) for message in data]
    raise ValueError(name)


def run(function, calls):
    for arguments in calls:
        function(*arguments)


def mark():
    # callgrind writes its counts whenever this C function is entered; nothing else calls it.
    os.getpgid(0)


def main(names):
    # A collection within a run would add hundreds of instructions to each call, and where it falls depends
    # on what was allocated before.
    gc.disable()
    for name in names:
        # bench/guard.py distinguishes them by the same two prefixes.
        short = BATCHED if name.startswith(("lookup_transforms", "set_transforms")) else SINGLE
        function, calls = case(name, WARM_UP + 3 * short)
        run(function, calls[:WARM_UP])
        mark()
        run(function, calls[WARM_UP : WARM_UP + short])
        mark()
        run(function, calls[WARM_UP + short :])
        mark()


if __name__ == "__main__":
    main(sys.argv[1:])
