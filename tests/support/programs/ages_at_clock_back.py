"""
Judges ages while the time of day is set back by an hour.

Run with `interposed/time_of_day.c` loaded: `ages_at_clock_back.py`. For each step it prints a line of JSON:
what, and the outcome.
"""

import asyncio
import copy
import ctypes
import json
import pickle
import tempfile
import threading
import time

import rclpy
from making_objects import S, transform
from waiting import DEADLINE_S, until

from tf2_ros import Buffer, TransformException

HOUR = 3600 * S
MAX_AGE_S = 2.0


def tell(what, outcome):
    print(json.dumps({"what": what, "outcome": outcome}), flush=True)


def buffer_with_data(seconds_old=0):
    """A buffer that was asked how old its data is, by a clock that is an hour ahead."""
    buffer = Buffer()
    CLOCK.value = HOUR
    insert(buffer, seconds_old)
    assert fresh(buffer) == (seconds_old == 0)
    return buffer


def insert(buffer, seconds_old=0):
    buffer.set_transform(transform("map", "odom", ns=time.time_ns() - S * seconds_old), "x")


def fresh(buffer):
    return buffer.can_transform("map", "odom", 0, max_age=MAX_AGE_S)


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
    """Whether a wait during which the clock is set back goes on until there is new data."""
    buffer = buffer_with_data(seconds_old=600)

    def set_back():
        until(lambda: buffer.statistics()["waiters"])
        CLOCK.value = 0
        assert not fresh(buffer)
        buffer.clear()  # which lets in samples that are older than what was there
        insert(buffer)

    thread = threading.Thread(target=set_back)
    thread.start()
    stamp = wait(buffer).header.stamp
    thread.join()
    return abs(stamp.sec - time.time()) < DEADLINE_S


def stale_data_stays_stale():
    """Also if the clock is ahead of the data by less than the limit after the step, or behind it."""
    ages = []
    for seconds_old, step_ns in ((600, HOUR), (3601, HOUR), (3600, HOUR + S // 2), (3, S)):
        buffer = buffer_with_data(seconds_old)
        CLOCK.value = HOUR - step_ns
        assert not fresh(buffer)
        ages.append(age_in(buffer) - seconds_old)
    return all(0 <= age < DEADLINE_S for age in ages)


def clock_catches_up():
    """Data does not become fresh when the clock reaches its stamp, whether or not it was judged meanwhile."""
    ages = []
    for is_judged in (False, True):
        buffer = buffer_with_data()
        began = time.monotonic()
        CLOCK.value = HOUR - 3 * S
        if is_judged:
            age_in(buffer)
        until(lambda begin=began: time.monotonic() - begin > 3.5)
        assert not fresh(buffer)
        ages.append(age_in(buffer))
    return all(3.5 < age < DEADLINE_S for age in ages)


def becomes_stale():
    """Whether the data that a clock was set back behind does not stay fresh; and what is said then."""
    buffer = buffer_with_data()
    CLOCK.value = 0
    assert fresh(buffer)
    until(lambda: not fresh(buffer))
    age = age_in(buffer)
    assert MAX_AGE_S < age < DEADLINE_S, age
    try:
        buffer.lookup_transform("map", "odom", 0, max_age=MAX_AGE_S)
    except TransformException as error:
        tell("error", str(error))
    tell("copies", all(is_as_stale(one, age) for one in copies(buffer)))
    # What arrives now is judged by its stamp, even if it is ahead of the clock.
    buffer.clear()
    buffer.set_transform(transform("map", "odom", ns=time.time_ns() + S), "x")
    return fresh(buffer)


def copies(buffer):
    return copy.copy(buffer), copy.deepcopy(buffer), pickle.loads(pickle.dumps(buffer))


def is_as_stale(copied, age):
    """Whether a copy knows of the step, and how old the data is, until a new sample arrives."""
    found = age_in(copied)
    assert age <= found < DEADLINE_S, (age, found)
    was_fresh = fresh(copied)
    copied.set_transform(transform("map", "odom", ns=time.time_ns() + S * 4000), "x")
    return not was_fresh and fresh(copied)


def copies_of_a_file():
    """The same for a buffer whose copies are the path of its file."""
    CLOCK.value = 0
    with tempfile.TemporaryDirectory() as folder:
        buffer_with_data().freeze(f"{folder}/frozen.tf2")
        buffer = Buffer.open(f"{folder}/frozen.tf2")
        fresh(buffer)
        CLOCK.value = 0
        until(lambda: not fresh(buffer))
        assert "frozen" in buffer.__getstate__()
        return all(is_as_stale(one, MAX_AGE_S) for one in copies(buffer))


def never_read_before():
    """A step before the first reading is noticed."""
    buffer = Buffer()
    CLOCK.value = HOUR
    buffer.set_transform(transform("map", "odom", ns=time.time_ns() - S * 600), "x")
    CLOCK.value = -HOUR
    until(lambda: not fresh(buffer))
    return True


rclpy.init()
CLOCK = ctypes.c_long.in_dll(ctypes.CDLL(None), "wall_offset_ns")
for way in (block, future, awaiting):
    tell(way.__name__, set_back_during(way))
tell("stale data", stale_data_stays_stale())
tell("the clock catches up", clock_catches_up())
tell("new data after stale data", becomes_stale())
tell("copies of a file", copies_of_a_file())
tell("never read before", never_read_before())
CLOCK.value = 0
rclpy.shutdown()
