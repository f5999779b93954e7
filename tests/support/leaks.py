"""Nothing is left by calls, however often they are made."""

import gc
import sys

SLACK = 50  # blocks; one object lost in forty of 2,000 calls shows


def assert_nothing_is_left(call, *objects, times=2000):
    """By a call, made so often: no memory of Python's, and no reference to any of the objects."""

    def left():
        gc.collect()
        before = sys.getallocatedblocks(), *map(sys.getrefcount, objects)
        for _ in range(times):
            call()
        gc.collect()
        after = sys.getallocatedblocks(), *map(sys.getrefcount, objects)
        return [now - then for now, then in zip(after, before, strict=True)]

    for _ in range(100):  # caches and free lists fill
        call()
    found = left()
    if abs(found[0]) >= SLACK:  # another thread has made something meanwhile; a leak goes on
        found = left()
    assert abs(found[0]) < SLACK and found[1:] == [0] * len(objects), found
