"""
Inserts into long histories, which must move, and does something else in the middle of the move.

Run with `interposed/held_history_moves.c` loaded: `held_history_moves.py FOLDER`. Whatever another thread
does meanwhile must end before the move does, and the buffer must then hold what one that does both in turn
holds. Prints how often a move was held.
"""

import ctypes
import pickle
import sys
import threading
from pathlib import Path

import numpy as np
from forked_children import in_a_child
from making_objects import at_ns, transform
from pickles_and_copies import held
from waiting import until

from tf2_ros import Buffer

FULL = 5166  # samples that fill the memory to the last slot, after sixteen times half of it more
HELD_BYTES = 100_000  # of the allocation for a move; nothing else here needs so much
FOLDER = Path(sys.argv[1])
library = ctypes.CDLL(None)


def variable(name):
    return ctypes.c_long.in_dll(library, name)


def link(ns, x=0.0, parent="map"):
    return transform(parent, "base", ns=ns, xyz=(x, 0, 0))


def filled(count=FULL):
    buffer = Buffer(cache_time=1.0)
    buffer.set_transforms([link(ns, ns) for ns in range(100, 100 + 2 * count, 2)], "x")
    buffer.set_transform_static(transform("base", "arm"), "x")
    return buffer


def opened(copies):
    path = FOLDER / "moves.tf2"
    filled().freeze(path)
    return Buffer.open(path, copy=copies)


def while_pinned(buffer, what):
    """Do it in the middle of a copy of the buffer."""
    empty, done = np.empty, []

    def do_and_make(*arguments):
        if not done:
            done.append(True)
            what()
        return empty(*arguments)

    np.empty = do_and_make
    try:
        buffer.__getstate__()
    finally:
        np.empty = empty


def at_once(_buffer, what):
    what()


# Which buffer must move its samples, when, and for which insert.
WAYS = {
    "it is full": (filled, at_once, link(50_000, 1)),
    "it is full, and the sample is late": (filled, at_once, link(501, 2)),
    "it is mapped": (lambda: opened(False), at_once, link(50_000, 3)),
    "it was read from a file": (lambda: opened(True), at_once, link(501, 4)),
    "somebody reads it": (lambda: filled(FULL - 500), while_pinned, link(501, 5)),
}


def insert_all(*links):
    def insert(buffer):
        for one in links:
            buffer.set_transform(one, "y")

    return insert


def insert_in_a_child(buffer):
    def insert():
        buffer.set_transform(link(60_000), "child")
        buffer.set_transform(link(601), "child")
        assert buffer.lookup_transform("map", "base", at_ns(60_000)).header.stamp.nanosec == 60_000
        buffer._self_check()

    assert in_a_child(insert) == 0


MEANWHILE = {
    "a lookup": lambda buffer: buffer.lookup_transform("map", "arm", at_ns(301)),
    "lookups": lambda buffer: buffer.lookup_transforms("map", "arm", np.arange(100, 900)),
    "a sample behind": insert_all(link(40_000, 7)),
    "a late sample": insert_all(link(301, 8)),
    "both": insert_all(link(301, 8), link(40_000, 7), link(303, 8)),
    "many behind": insert_all(*[link(20_000 + ns, 7) for ns in range(400)]),
    "samples that end all others": insert_all(*[link(ns) for ns in (2 * 10**9, 4 * 10**9, 4 * 10**9 + 1)]),
    "samples that end some": insert_all(link(10**9 + 5000), link(10**9 + 6000)),
    "another parent": insert_all(link(40_000, 9, "odom"), link(307, 9, "odom")),
    "a static transform": lambda buffer: buffer.set_transform_static(link(0, 4), "y"),
    "clear": Buffer.clear,
    "clear, and samples": lambda buffer: (buffer.clear(), insert_all(link(40_000), link(301))(buffer)),
    "forget": lambda buffer: buffer.forget("base"),
    "init": lambda buffer: buffer.__init__(cache_time=1.0),
    "another state": lambda buffer: buffer.__setstate__(filled(10).__getstate__()),
    "a pickle": pickle.dumps,
    "a file": lambda buffer: buffer.freeze(FOLDER / "meanwhile.tf2"),
    "a fork": insert_in_a_child,
}


def hold(fails=0):
    variable("goes_on").value = 0
    variable("fails").value = fails
    variable("held_bytes").value = HELD_BYTES


def insert_meanwhile(buffer, one, meanwhile):
    thread = threading.Thread(target=buffer.set_transform, args=(one, "x"))
    hold()
    thread.start()
    until(lambda: variable("is_held").value)
    meanwhile(buffer)
    assert variable("is_held").value
    buffer._self_check()
    variable("goes_on").value = 1
    thread.join()


def check(way, meanwhile):
    make, around, one = WAYS[way]
    buffer, twin = make(), make()
    stamp = at_ns(one.header.stamp.nanosec)
    waiting = buffer.wait_for_transform_async("map", "base", at_ns(50_000))
    around(buffer, lambda: insert_meanwhile(buffer, one, MEANWHILE[meanwhile]))
    MEANWHILE[meanwhile](twin)
    twin.set_transform(one, "x")
    buffer._self_check()
    assert held(buffer) == held(twin), (way, meanwhile)
    assert buffer.can_transform("map", "base", stamp) == twin.can_transform("map", "base", stamp)
    assert waiting.done() or not buffer.can_transform("map", "base", at_ns(50_000)), (way, meanwhile)


def check_without_memory(way):
    make, around, one = WAYS[way]
    buffer, twin = make(), make()
    errors = []

    def insert():
        variable("goes_on").value = 1
        try:
            buffer.set_transform(one, "x")
        except MemoryError as error:
            errors.append(error)

    hold(fails=1)
    variable("goes_on").value = 1
    around(buffer, insert)
    buffer._self_check()
    assert len(errors) == 1
    assert held(buffer) == held(twin), way
    variable("fails").value = 0
    insert_all(one)(buffer)
    insert_all(one)(twin)
    assert held(buffer) == held(twin), way


def main():
    count = 0
    for way in WAYS:
        for meanwhile in MEANWHILE:
            check(way, meanwhile)
            count += 1
        check_without_memory(way)
    assert not variable("gave_up").value
    print(count)


if __name__ == "__main__":
    main()
