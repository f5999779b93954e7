# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Judges ages while the time of day is set back.

Run with `interposed/time_of_day.c` loaded: `judges_ages_while_time_is_set.py`. For each step it prints a line
of JSON: what, and the outcome.
"""

import asyncio
import copy
import ctypes
import json
import pickle
import tempfile
import threading
import time
from contextlib import suppress

import rclpy
from times_and_transforms import S, transform
from waiting import DEADLINE_S, until

from tf2_ros import Buffer, TransformException

HOUR = 3600 * S
MAX_AGE_S = 5.0


def tell(what, outcome):
    print(json.dumps({"what": what, "outcome": outcome}), flush=True)


def insert(buffer, seconds_old=0):
    buffer.set_transform(transform("map", "odom", ns=time.time_ns() - S * seconds_old), "x")


def buffer_with_data(seconds_old=0, source=True):
    """A buffer with data, by a clock that is an hour ahead."""
    buffer = Buffer()
    if source:
        buffer.add_source("this program")
    CLOCK.value = HOUR
    insert(buffer, seconds_old)
    buffer.ages("map", "odom")
    return buffer


def has_answer(buffer):
    try:
        buffer.lookup_transform("map", "odom", 0, max_age=MAX_AGE_S)
    except TransformException as error:
        assert "part of the same tree" in str(error), error
        return False
    return True


def age_in(buffer):
    [age] = buffer.ages("map", "odom").values()
    return age


def block(buffer):
    return buffer.lookup_transform("map", "odom", 0, DEADLINE_S, max_age=MAX_AGE_S)


def future(buffer):
    pending = buffer.wait_for_transform_async("map", "odom", 0, max_age=MAX_AGE_S)
    until(pending.done)
    return pending.result()


def awaiting(buffer):
    return asyncio.run(buffer.lookup_transform_async("map", "odom", 0, max_age=MAX_AGE_S))


def set_back_during(wait):
    """Whether a wait notices by itself that the clock is set back, and then takes what had been refused."""
    buffer, over = buffer_with_data(seconds_old=600), threading.Event()

    def set_back():
        until(lambda: buffer.statistics()["waiters"])
        CLOCK.value = 0
        until(lambda: insert(buffer) or over.is_set())

    thread = threading.Thread(target=set_back)
    thread.start()
    try:
        stamp = wait(buffer).header.stamp
    finally:
        over.set()
        thread.join()
    return abs(stamp.sec - time.time()) < DEADLINE_S


def cleared(step_ns, asks, **made):
    """Whether a question finds the buffer cleared after a step, and new data is taken after that."""
    buffer = buffer_with_data(**made)
    CLOCK.value = HOUR - step_ns
    with suppress(TransformException):
        asks(buffer)
    is_cleared = buffer.statistics()["samples"] == 0
    insert(buffer)
    assert has_answer(buffer) and abs(age_in(buffer)) < DEADLINE_S or not is_cleared
    return is_cleared


def copies(buffer):
    with tempfile.TemporaryDirectory() as folder:
        buffer.freeze(f"{folder}/frozen.tf2")
        yield from (copy.copy(buffer), copy.deepcopy(buffer), pickle.loads(pickle.dumps(buffer)))
        yield Buffer.open(f"{folder}/frozen.tf2")


def copies_keep_their_data():
    made = list(copies(buffer_with_data()))
    CLOCK.value = HOUR - 60 * S
    return all(-61 < age_in(one) < 0 for one in made)


rclpy.init()
CLOCK = ctypes.c_long.in_dll(ctypes.CDLL(None), "wall_offset_ns")
for way in (block, future, awaiting):
    tell(way.__name__, set_back_during(way))
tell("an hour, lookup", cleared(HOUR, has_answer))
tell("an hour, ages", cleared(HOUR, age_in))
tell("a second", cleared(S, has_answer))
tell("half a second", cleared(S // 2, has_answer))
tell("not judged", cleared(HOUR, lambda buffer: buffer.lookup_transform("map", "odom", 0)))
tell("without a source", cleared(HOUR, has_answer, source=False))
tell("copies", copies_keep_their_data())
CLOCK.value = 0
rclpy.shutdown()
