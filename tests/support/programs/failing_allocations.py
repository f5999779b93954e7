# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Takes random steps with a buffer while allocations fail.

Run with `interposed/failing_allocations.c` loaded: `failing_allocations.py SEED STEPS`. In each step a random
allocation fails, alone or with all that follow it; the step must then raise MemoryError and leave the buffer
as it was. After that it is taken with memory. Prints how many failures there were of each kind of step, as
JSON.
"""

import copy
import ctypes
import gc
import itertools
import json
import pickle
import random
import sys
import threading
import warnings
from collections import Counter

import numpy as np
from pickles_and_copies import everything
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from times_and_transforms import S, about_z, transform

from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore, TransformException
from tf2_ros import Buffer
from tf2_ros_cython._installation import PACKAGES

FRAMES = ("map", "odom", "base", "camera", "nobody")
NOBODY, ENGINE = 0, 1  # of `interposed/failing_allocations.c`
KEPT = 20  # blocks that Python keeps for itself now and then
FIRST = (1, 1, 2, 2, 3, 4, 6, 9)  # which allocation of a step fails: most steps need few
library = ctypes.CDLL(None)


def variable(name, kind=ctypes.c_long):
    return kind.in_dll(library, name)


def seen(buffer, waits):
    """All that the buffer holds and counts, and who waits; not how much memory it has."""
    buffer._self_check()
    found = everything(buffer)
    del found["statistics"]["bytes"]
    return found, [one.done() for one in waits if hasattr(one, "done")]


# The steps: each function returns a call on a buffer and its waits.


def random_link(dice):
    parent, child = dice.choice([*itertools.combinations(FRAMES[:4], 2), (FRAMES[3], "map")])
    if dice.random() < 0.4:
        child = f"{dice.choice('abc')}{dice.randrange(200)}" * dice.choice((1, 1, 1, 300))
    seconds, turn = dice.randrange(0, 60) / 8, about_z(dice.random())
    return transform(parent, child, seconds, (dice.random(), 0, 0), turn)


def insert(dice):
    link, authority = random_link(dice), f"by {dice.randrange(100)}"
    name = dice.choice(("set_transform", "set_transform", "set_transform", "set_transform_static"))
    return lambda buffer, waits: getattr(buffer, name)(link, authority)


def insert_many(dice):
    links = [random_link(dice) for _ in range(dice.randrange(2, 40))]
    if dice.random() < 0.5:
        data = serialize_message(TFMessage(transforms=links))
        return lambda buffer, waits: buffer.set_transforms_cdr(data, "many")
    return lambda buffer, waits: buffer.set_transforms(links, "many")


def replace(dice):
    links, static = [random_link(dice) for _ in range(dice.randrange(1, 40))], dice.random() < 0.2
    return lambda buffer, waits: buffer.set_transforms(links, "many", static, replace=True)


def remove(dice):
    frame = dice.choice((*FRAMES, None, None))

    def call(buffer, waits):
        if frame is None:
            buffer.clear()
        elif frame in buffer:
            buffer.forget(frame)

    return call


def look_up(dice):
    target, source = dice.choices(FRAMES, k=2)
    ns, times = dice.randrange(8) * S, np.linspace(S, dice.randrange(1, 9) * S, 100).astype(np.int64)
    interval, points = Duration(seconds=1), np.ones((100, 3))
    ask = dice.choice(
        (
            lambda b: b.lookup_transform_core(target, source, ns),
            lambda b: b.lookup_transform_full_core(target, ns, source, S, "map"),
            lambda b: b.can_transform_core(target, source, ns),
            lambda b: b.lookup_transforms(target, ["odom", "base", source] * 8, times, on_missing="nan"),
            lambda b: b.lookup_matrices(target, ["odom", source], times, on_missing="nan"),
            lambda b: b.lookup_matrix(target, source, ns),
            lambda b: b.transform_points(points, times, target, source),
            lambda b: b.lookupVelocityCore(source, target, ns, interval),
            lambda b: (b.all_frames_as_yaml(), b._allFramesAsDot(ns), b.frames(), b.tree()),
            lambda b: b.time_range(target, source),
            lambda b: b.explain(target, source, ns),
            lambda b: (b.histories(), b.statistics().keys(), b._getFrameStrings(), source in b),
        )
    )

    def call(buffer, waits):
        try:
            ask(buffer)
        except TransformException:
            pass  # an answer, too

    return call


def wait(dice):
    (target, source), ns = dice.choices((*FRAMES, "a1"), k=2), dice.randrange(9) * S
    is_future = dice.random() < 0.5

    def call(buffer, waits):
        if is_future and isinstance(buffer, Buffer):
            waits.append(buffer.wait_for_transform_async(target, source, ns))
        else:
            waits.append(buffer._wait(target, source, ns))

    return call


def end_waits(dice):
    count = dice.randrange(8)

    def call(buffer, waits):
        for one in waits[:count]:
            one.cancel()

    return call


def travel(dice):
    make = dice.choice((copy.copy, lambda buffer: pickle.loads(pickle.dumps(buffer))))
    return lambda buffer, waits: make(buffer)


def restore(dice):
    other = BufferCore()
    other.set_transforms([random_link(dice) for _ in range(5)], "before")
    state = other.__getstate__()
    return lambda buffer, waits: buffer.__setstate__(state)


STEPS = (insert,) * 6 + (insert_many, insert_many, remove, look_up, look_up, look_up, wait, wait)
STEPS += (end_waits, travel, restore, replace, replace)


# Another kind of buffer after every FRESH steps, so that memory grows anew.
KINDS = (BufferCore, Buffer)
FRESH = 25


def fails(call, buffer, waits, first, last):
    """Whether the call raised, with these allocations failing."""
    raised = None
    variable("counted").value = variable("failed").value = 0
    variable("first_to_fail").value, variable("last_to_fail").value = first, last
    counted_of = variable("counted_of")
    counted_of.value = ENGINE
    try:
        call(buffer, waits)
    except BaseException as error:
        counted_of.value = NOBODY
        raised = error
    counted_of.value = NOBODY
    assert raised is None or (isinstance(raised, MemoryError) and variable("failed").value), repr(raised)
    return raised is not None


def take(step, dice, buffer, waits, counts):
    """Take one step, first without memory for some of it."""
    call, first = step(dice), dice.choice(FIRST)
    before, count = seen(buffer, waits), len(waits)
    if not fails(call, buffer, waits, first, first if dice.random() < 0.7 else 10**9):
        return
    counts[step.__name__] += 1
    del waits[count:]
    after = seen(buffer, waits)
    # Of many transforms, those before the one without memory are kept.
    assert after == before or step is insert_many, step.__name__
    call(buffer, waits)
    buffer._self_check()


def run(seed, steps):
    """Take random steps, with fresh buffers of some kind after each few; count the failures by step."""
    dice, counts = random.Random(seed), Counter()
    for _ in range(steps // FRESH):
        buffer, waits = dice.choice(KINDS)(8.0), []
        for _ in range(FRESH):
            take(dice.choice(STEPS), dice, buffer, waits, counts)
        for one in waits:
            one.cancel()
        del buffer, waits
        gc.collect()
    return counts


def main():
    warnings.simplefilter("ignore")
    seed, steps = map(int, sys.argv[1:])
    folders = [f"/{package}/".encode() for package in PACKAGES]
    assert library.find_ours((ctypes.c_char_p * (len(folders) + 1))(*folders)) > 0
    variable("counted_thread", ctypes.c_ulong).value = threading.get_ident()
    lives = []
    for _ in range(4):
        counts = run(seed, steps // 4)
        lives.append(variable("live").value)
    # What is lost is lost each time.
    lost = min(after - before for before, after in itertools.pairwise(lives[1:]))
    assert lost <= KEPT, f"{lost} blocks of memory are lost"
    print(json.dumps(counts))


if __name__ == "__main__":
    main()
