"""
Takes random steps with a buffer while allocations fail, and the same steps with a twin that has memory.

Run with `interposed/allocations.c` loaded: `allocations.py SEED STEPS`. Each step is tried with its first
allocation failing, then its second, and so on, alone or with all that follow it, until it succeeds. Each
failure must raise MemoryError and leave the buffer as it was; the success must do what it does in the twin.
Prints how many failures there were of each kind of step, as JSON.
"""

import copy
import ctypes
import gc
import itertools
import json
import pickle
import random
import sys
import tempfile
import threading
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from making import S, about_z, transform
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from travelling import everything

import tf2_ros_tools.bag
from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore, TransformException
from tf2_ros import Buffer, SharedBufferError

FRAMES = ("map", "odom", "base", "camera", "nobody")
NOBODY, ENGINE = 0, 1  # of `interposed/allocations.c`
KEPT = 20  # blocks that Python keeps for itself now and then
library = ctypes.CDLL(None)
FOLDER = tempfile.TemporaryDirectory(prefix="tf2-allocations-")


def variable(name, kind=ctypes.c_long):
    return kind.in_dll(library, name)


class Side:
    """A buffer, a buffer that reads what it shares, its waits, and what these were answered."""

    def __init__(self, make):
        self.buffer, self.waits, self.answered = make(), [], []
        sharing = getattr(self.buffer, "_tf2_sharing", None)
        self.readers = [Buffer(attach=sharing.name)] if sharing else []

    def seen(self):
        """All that the buffer answers and lists, and who waits; not how much memory it has."""
        for buffer in (self.buffer, *self.readers):
            buffer._self_check()
        found = everything(self.buffer, FRAMES[:3], [2 * S, 7 * S // 2])
        del found["statistics"]["bytes"]
        futures = [wait.done() for wait in self.waits if hasattr(wait, "done")]
        return found, sorted(self.buffer._pending_waits()), sorted(map(str, self.answered)), futures

    def end(self):
        for wait in self.waits:
            wait.cancel()
        for reader in self.readers:
            reader._tf2_sharing.close()


# The steps: each function returns a call on a Side.


def random_link(dice):
    parent, child = dice.choice([*itertools.combinations(FRAMES[:4], 2), (FRAMES[3], "map")])
    if dice.random() < 0.4:
        child = f"{dice.choice('abc')}{dice.randrange(200)}" * dice.choice((1, 1, 1, 300))
    seconds, turn = dice.randrange(0, 60) / 8, about_z(dice.random())
    return transform(parent, child, seconds, (dice.random(), 0, 0), turn)


def insert(dice):
    link, authority = random_link(dice), f"by {dice.randrange(100)}"
    name = dice.choice(("set_transform", "set_transform", "set_transform", "set_transform_static"))
    return lambda side: getattr(side.buffer, name)(link, authority)


def insert_many(dice):
    links = [random_link(dice) for _ in range(dice.randrange(2, 40))]
    data = serialize_message(TFMessage(transforms=links)) if dice.random() < 0.5 else None

    def call(side):
        if data is not None:
            return side.buffer.set_transforms_cdr(data, "many")
        return side.buffer.set_transforms(links, "many")

    call.links = links, "many"
    return call


def remove(dice):
    frame = dice.choice((*FRAMES, None, None))

    def call(side):
        if frame is None:
            side.buffer.clear()
        elif frame in side.buffer:
            side.buffer.forget(frame)

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
            lambda b: b.get_latest_common_time(target, source),
            lambda b: b.lookup_transforms(target, source, times, on_missing="nan"),
            lambda b: b.lookup_transforms(target, ["odom", "base", source] * 8, times),
            lambda b: b.transform_points(points, times, target, source),
            lambda b: b.lookupVelocityCore(source, target, ns, interval),
            lambda b: b.lookup_velocities(source, target, times, interval, on_missing="nan"),
            lambda b: (b.all_frames_as_yaml(), b._allFramesAsDot(ns), b.frames(), b.tree()),
            lambda b: (b.histories(), b.statistics().keys(), b._getFrameStrings(), source in b),
        )
    )

    def call(side):
        try:
            return ask(side.buffer)
        except TransformException as error:
            return error

    return call


def wait(dice):
    (target, source), ns = dice.choices((*FRAMES, "a1"), k=2), dice.randrange(9) * S
    kind = dice.choice(("future", "notified", "blocking"))

    def call(side):
        if kind == "future" and isinstance(side.buffer, Buffer):
            future = side.buffer.wait_for_transform_async(target, source, ns)
            side.waits.append(future)
            return future.done()
        notify = side.answered.append if kind == "notified" else None
        one = side.buffer._wait(target, source, ns, notify=notify)
        side.waits.append(one)
        return one.answer

    return call


def end_waits(dice):
    count, timeout = dice.randrange(8), dice.choice((0.0, 1e-6))

    def call(side):
        for one in side.waits[:count]:
            one.cancel()
        if isinstance(side.buffer, Buffer):
            return side.buffer.can_transform("map", "nobody", 20 * S, timeout)
        return None

    return call


def travel(dice):
    path = Path(FOLDER.name, "saved.mcap")

    def by_file(buffer):
        buffer.save(path)
        return BufferCore.load(path)

    def by_bag(buffer):
        BufferCore.save(buffer, path)
        return tf2_ros_tools.bag.load(path)

    make = dice.choice((copy.copy, by_file, by_bag, lambda buffer: pickle.loads(pickle.dumps(buffer))))

    def call(side):
        return {name: bytes(one.stamps_ns) for name, one in make(side.buffer).histories().items()}

    return call


def restore(dice):
    other = BufferCore()
    other.set_transforms([random_link(dice) for _ in range(5)], "before")
    state = other.__getstate__() | {"max_frames": 1000}
    state["attributes"] = {}

    def call(side):
        side.buffer.__setstate__(state)

    return call


def read_shared(_dice):
    def call(side):
        # A reader that has no memory for a message logs it, and goes on with the next one.
        for reader in side.readers:
            reader.can_transform_core("map", "odom", 0)

    return call


STEPS = (insert,) * 6 + (insert_many, insert_many, remove, look_up, look_up, look_up, wait, wait)
STEPS += (end_waits, travel, restore, read_shared)


def shared(name):
    numbers = itertools.count()
    return lambda: Buffer(8.0, share=f"{name}-{next(numbers)}-{threading.get_native_id()}")


# How often each kind of buffer is taken: another kind after every FRESH steps, so that memory grows anew.
KINDS = (lambda: BufferCore(8.0), lambda: Buffer(8.0), shared("allocations"))
FRESH = 25


def attempt(call, side, first, last):
    """Call with these allocations failing; how many did, what was raised, and what was returned."""
    raised = returned = None
    variable("counted").value = variable("failed").value = 0
    variable("first_to_fail").value, variable("last_to_fail").value = first, last
    counted_of = variable("counted_of")
    counted_of.value = ENGINE
    try:
        returned = call(side)
    except BaseException as error:
        counted_of.value = NOBODY
        raised = error
    counted_of.value = NOBODY
    return variable("failed").value, raised, repr(returned)


def inserted_so_far(side, twin, links, authority):
    """Of many transforms, those before the one without memory are kept: insert them into the twin."""
    for link in links:
        if side.buffer.statistics()["taken"] == twin.buffer.statistics()["taken"]:
            break
        twin.buffer.set_transform(link, authority)
    return twin.seen()


def take(step, dice, side, twin, counts):
    """Take one step, in all the ways in which it may fail."""
    call = step(dice)
    is_alone = dice.random() < 0.7
    before = side.seen()
    for n in itertools.count(1):
        waits = len(side.waits)
        failed, raised, returned = attempt(call, side, n, n if is_alone else 10**9)
        if raised is None:
            break
        assert failed, raised
        assert isinstance(raised, (MemoryError, SharedBufferError)), (step.__name__, n, repr(raised))
        del raised, side.waits[waits:]
        counts[step.__name__] += 1
        if step is insert_many:
            before = inserted_so_far(side, twin, *call.links)
        assert side.seen() == before, (step.__name__, n)
    counts[step.__name__] += bool(failed)  # of something that was not necessary
    assert returned == repr(call(twin)), (step.__name__, returned)
    assert side.seen() == twin.seen(), step.__name__


def run(seed, steps):
    """Take random steps, with fresh buffers of some kind after each few; count the failures by step."""
    dice, counts = random.Random(seed), Counter()
    while steps > 0:
        make = dice.choice(KINDS)
        side, twin = Side(make), Side(make)
        for _ in range(FRESH):
            take(dice.choice(STEPS), dice, side, twin, counts)
            steps -= 1
        side.end()
        twin.end()
        del side, twin
        gc.collect()
    return counts


def main():
    warnings.simplefilter("ignore")
    seed, steps = map(int, sys.argv[1:])
    library.find_ours()
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
