"""
Judges ages while the time of day is set back by an hour: `clock_back.py`, with `interposed/clocks.c`.

For each step it prints a line of JSON: what, and the outcome.
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
from making import S, transform
from processes import DEADLINE_S, until

from tf2_ros import Buffer, TransformException

HOUR = 3600 * S
MAX_AGE_S = 2.0


def tell(what, outcome):
    print(json.dumps({"what": what, "outcome": outcome}), flush=True)


def ahead():
    """A buffer whose data is ten minutes old by a clock that is an hour ahead."""
    buffer = Buffer()
    CLOCK.value = HOUR
    buffer.set_transform(transform("map", "odom", ns=time.time_ns() - S * 600), "x")
    assert not fresh(buffer)
    return buffer


def fresh(buffer):
    return buffer.can_transform("map", "odom", 0, max_age=MAX_AGE_S)


def block(buffer):
    return buffer.can_transform("map", "odom", 0, DEADLINE_S, max_age=MAX_AGE_S)


def future(buffer):
    pending = buffer.wait_for_transform_async("map", "odom", 0, max_age=MAX_AGE_S)
    until(pending.done)
    return pending.result().header.frame_id == "map"


def awaiting(buffer):
    found = asyncio.run(buffer.lookup_transform_async("map", "odom", 0, max_age=MAX_AGE_S))
    return found.header.frame_id == "map"


def set_back_during(wait):
    """What a wait says while which the clock is set back."""
    buffer = ahead()

    def set_back():
        until(lambda: buffer.statistics()["waiters"])
        CLOCK.value = 0

    thread = threading.Thread(target=set_back)
    thread.start()
    outcome = wait(buffer)
    thread.join()
    return outcome


def becomes_stale():
    """Whether the data that a clock was set back behind does not stay fresh; and what is said then."""
    buffer = ahead()
    CLOCK.value = 0
    until(lambda: not fresh(buffer))
    [age] = buffer.ages("map", "odom").values()
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
    """Whether a copy knows of the step, and of how long ago it was, until a new sample arrives."""
    [found] = copied.ages("map", "odom").values()
    assert age <= found < DEADLINE_S, (age, found)
    was_fresh = fresh(copied)
    copied.set_transform(transform("map", "odom", ns=time.time_ns() + S * 4000), "x")
    return not was_fresh and fresh(copied)


def copies_of_a_file():
    """The same for a buffer whose copies are the path of its file."""
    CLOCK.value = 0
    with tempfile.TemporaryDirectory() as folder:
        ahead().freeze(f"{folder}/frozen.tf2")
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
tell("new data after stale data", becomes_stale())
tell("copies of a file", copies_of_a_file())
tell("never read before", never_read_before())
CLOCK.value = 0
rclpy.shutdown()
