# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Keeps answers, and parts of them, in every way while threads, signals and finalizers look up.

``keeps_answers.py LOOKUPS``; prints how many lookups were made, how many answers and parts were kept, and
those that changed or were wrong. Each thread drops half of its answers, so that the next lookups can use
these messages again.
"""

import copy
import gc
import json
import math
import pickle
import queue
import random
import signal
import sys
import threading
from functools import cache
from itertools import count, pairwise

from messages_with_or_without_ros import TransformStamped
from random_runs import first_seed
from times_and_transforms import S, at_ns, rotation, stamp_ns, transform, translation

from tf2_py import BufferCore
from tf2_ros.serialization import serialize_transforms

FRAMES = 6
NAMES = [f"f{i}" for i in range(FRAMES)]
THREADS = 4
SECONDS = 5
PARTS = (
    "header",
    "header.stamp",
    "header.frame_id",
    "transform",
    "transform.translation",
    "transform.translation.x",
    "transform.rotation",
    "transform.rotation.w",
)


def filled():
    """Each frame moves along x in its parent at 1 m/s, and turns about x at 0.1 rad/s."""
    buffer = BufferCore()
    for parent, child in pairwise(NAMES):
        for second in range(SECONDS + 1):
            turn = second * 0.1 / 2
            moved = transform(parent, child, second, (second, 0, 0), (math.sin(turn), 0, 0, math.cos(turn)))
            buffer.set_transform(moved, "me")
    return buffer


buffer = filled()
kept, wrong, lookups = [], [], count()
to_publish = queue.SimpleQueue()
# What alters messages, and what finds those of others.
altering = threading.Lock()


def values(thing):
    """What a message or part consists of."""
    if thing is None or isinstance(thing, float | int | str):
        return thing
    # From a list: gc.get_referrers() may find a tuple that still grows, which then fails.
    return tuple([values(getattr(thing, name, None)) for name in fields(type(thing))])


@cache
def fields(cls):
    """The slots of a message class, also those of its base."""
    return [name for base in cls.__mro__ for name in getattr(base, "__slots__", ())]


def keep(thing, holder=None):
    """Note a message or part, with what it is now; ``holder``: what refers to it if this does not."""
    kept.append((thing if holder is None else holder, holder is not None, values(thing)))


def looked_up(draw):
    """An answer, which has been checked."""
    target, source = sorted(draw.sample(range(FRAMES), 2))
    time_ns = draw.randrange(1, SECONDS * S)
    answer = buffer.lookup_transform_core(NAMES[target], NAMES[source], at_ns(time_ns))
    next(lookups)
    x = (source - target) * time_ns / S
    wanted = (
        NAMES[target],
        NAMES[source],
        time_ns,
        (x, 0, 0),
        (math.sin(x * 0.1 / 2), 0, 0, math.cos(x * 0.1 / 2)),
    )
    got = (
        answer.header.frame_id,
        answer.child_frame_id,
        stamp_ns(answer),
        translation(answer),
        rotation(answer),
    )
    if got[:3] != wanted[:3] or math.dist(got[3], wanted[3]) > 1e-6 or math.dist(got[4], wanted[4]) > 1e-6:
        wrong.append([repr(wanted), repr(got)])
    return answer


def part_of(answer, draw):
    part = answer
    for name in draw.choice(PARTS).split("."):
        part = getattr(part, name)
    return part


def suspended(thing):
    yield
    yield thing


async def asleep(thing, forever):
    await forever
    return thing


class Forever:
    def __await__(self):
        yield


def failed(thing):
    try:
        raise ValueError
    except ValueError as error:
        return error


class LooksUpAtItsEnd:
    def __init__(self, draw):
        self.draw, self.itself = draw, self  # only the collector ends it

    def __del__(self):
        keep(looked_up(self.draw))


class Other(TransformStamped):
    __slots__ = ()


def keep_somehow(draw):
    answer = looked_up(draw)
    how = draw.randrange(11)
    if how < 3:
        keep(answer)
    elif how < 6:
        keep(part_of(answer, draw))
    elif how == 6:
        keep(draw.choice((copy.copy, copy.deepcopy))(answer))
    elif how == 7:
        keep(pickle.loads(pickle.dumps(answer)))
    elif how == 8:
        holder = suspended(answer)
        next(holder)
        keep(answer, lambda: next(holder))
    elif how == 9:
        coroutine = asleep(answer, Forever())
        coroutine.send(None)
        keep(answer, lambda: ended(coroutine))
    else:
        error = failed(answer)
        keep(answer, lambda: error.__traceback__.tb_frame.f_locals["thing"])


def ended(coroutine):
    try:
        coroutine.send(None)
    except StopIteration as end:
        return end.value
    raise AssertionError


def alter(draw):
    """Alter an answer, in a way that a message that is used again must not show, and perhaps keep it."""
    with altering:
        answer = looked_up(draw)
        how = draw.randrange(8)
        if how == 0:
            answer.header.frame_id, answer.child_frame_id = "mine", "mine, too"
            answer.transform.translation.y = answer.transform.rotation.w = 99.0
        elif how == 1:
            answer.header = looked_up(draw).header
        elif how == 2:
            other = looked_up(draw)
            answer.transform, other.transform.rotation = other.transform, answer.transform.rotation
        elif how == 3:
            answer.__class__ = Other
        elif how == 4:
            slot = draw.choice(type(answer.transform.translation).__slots__)
            delattr(answer.transform.translation, slot)
        elif how == 5:
            setattr(
                answer.transform.translation,
                type(answer.transform.translation).__slots__[0],
                LooksUpAtItsEnd(draw),
            )
        elif how == 6:
            answer.header.stamp = answer.header.stamp
        else:
            setattr(answer.header.stamp, type(answer.header.stamp).__slots__[0], True)
        if how not in (4, 5) and draw.random() < 0.3:
            keep(answer)


def trace(draw):
    """Look up at each line of another lookup's function."""

    def at_line(frame, event, _):
        if draw.random() < 0.05:
            sys.settrace(None)
            keep(looked_up(draw))
            sys.settrace(at_line)
        return at_line

    sys.settrace(at_line)
    try:
        keep_somehow(draw)
    finally:
        sys.settrace(None)


def work(draw, times):
    for i in range(times):
        if i % 2:
            looked_up(draw)  # dropped at once, or by what comes next
            continue
        how = draw.randrange(40)
        if how == 0:
            trace(draw)
        elif how == 1:
            LooksUpAtItsEnd(draw)
        elif how < 6:
            alter(draw)
        elif how < 10:
            answer = looked_up(draw)
            to_publish.put((answer, values(answer)))
            del answer
        elif how < 30:
            keep_somehow(draw)
        else:
            previous = looked_up(draw)  # noqa: F841  # until the next one


def publish():
    while (given := to_publish.get()) is not None:
        message, before = given
        data = serialize_transforms([message])
        if values(message) != before or serialize_transforms([message]) != data:
            wrong.append(f"published: {message!r}")
        given = message = None


def collect(draw):
    while not finished.wait(0.02):
        gc.collect(draw.randrange(3))
        with altering:
            # gc.get_objects() would find more things that must not be found while they grow.
            found = [one for one in gc.get_referrers(draw.choice(NAMES)) if type(one) is TransformStamped]
            for one in draw.sample(found, min(5, len(found))):
                if None not in flat(values(one)):
                    keep(one)
        del found


def flat(value):
    return [one for part in value for one in flat(part)] if isinstance(value, tuple) else [value]


def in_handler(*_):
    answer = looked_up(of_handler)
    if of_handler.random() < 0.5:
        keep(answer)
    if not finished.is_set():
        signal.setitimer(signal.ITIMER_REAL, 0.003)


def run():
    sys.setswitchinterval(1e-4)
    gc.set_threshold(200, 10, 10)
    seeds = count(first_seed())
    threads = [
        threading.Thread(target=work, args=(random.Random(next(seeds)), int(sys.argv[1]) // THREADS))
        for _ in range(THREADS - 1)
    ]
    others = [threading.Thread(target=publish)]
    others.append(threading.Thread(target=collect, args=(random.Random(next(seeds)),)))
    signal.signal(signal.SIGALRM, in_handler)
    signal.setitimer(signal.ITIMER_REAL, 0.003)
    for thread in (*threads, *others):
        thread.start()
    work(random.Random(next(seeds)), int(sys.argv[1]) // THREADS)
    for thread in threads:
        thread.join()
    finished.set()
    signal.setitimer(signal.ITIMER_REAL, 0)
    to_publish.put(None)
    for thread in others:
        thread.join()


of_handler, finished = random.Random(first_seed()), threading.Event()
run()
changed = []
for thing, is_call, before in kept:
    now = values(thing() if is_call else thing)
    if now != before:
        changed.append([repr(before), repr(now)])
kept_count = len(kept)
del thing
kept.clear()
gc.collect()
kept.clear()  # what finalizers have kept
left = sum(type(one) in (TransformStamped, Other) for one in gc.get_objects())
print(
    json.dumps(
        {
            "lookups": next(lookups),
            "kept": kept_count,
            "changed": changed[:9],
            "wrong": wrong[:9],
            "left": left,
        }
    )
)
