# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Follow the changes of a buffer into which several threads insert: one call at a time, and none is lost."""

import random
import sys
import threading
import time

from geometry_msgs.msg import TransformStamped

from tf2_ros import Buffer

S = 1_000_000_000
THREADS, INSERTS = 3, 30
LAST_S = 20.0  # what the last change never takes to arrive
# The rarest fault that this has found needed two thousand rounds with it.
SWITCH_S = 1e-6


class Follower:
    """Notes what it is called with, and what is wrong with that."""

    def __init__(self):
        self.stamps_ns, self.problems, self._lock = [], [], threading.Lock()

    def __call__(self, transform):
        if not self._lock.acquire(blocking=False):
            self.problems.append("on_change: two calls at once")
            return
        try:
            stamp_ns = transform.header.stamp.sec * S + transform.header.stamp.nanosec
            if self.stamps_ns and stamp_ns <= self.stamps_ns[-1]:
                self.problems.append(f"on_change: {stamp_ns} ns after {self.stamps_ns[-1]} ns")
            self.stamps_ns.append(stamp_ns)
            if random.random() < 0.2:
                time.sleep(random.random() * 1e-4)  # a function that is slower than the changes
        finally:
            self._lock.release()

    def has(self, stamp_ns):
        return bool(self.stamps_ns) and self.stamps_ns[-1] == stamp_ns


def sample(stamp_ns):
    made = TransformStamped(child_frame_id="base")
    made.header.frame_id = "map"
    made.header.stamp.sec, made.header.stamp.nanosec = divmod(stamp_ns, S)
    return made


def follow_once(**limits):
    """One round with a buffer of its own; what went wrong in it."""
    buffer, follower, first_ns = Buffer(cache_time=1e6), Follower(), time.time_ns()
    subscription = buffer.on_change("map", "base", follower, **limits)

    def insert(number):
        for i in range(INSERTS):
            buffer.set_transform(sample(first_ns + (i * THREADS + number) * 1000), "stress")

    threads = [threading.Thread(target=insert, args=(number,)) for number in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    last_ns = first_ns + (THREADS * INSERTS - 1) * 1000
    deadline_s = time.monotonic() + LAST_S
    while not follower.has(last_ns) and time.monotonic() < deadline_s:
        time.sleep(0.001)
    if not follower.has(last_ns):
        follower.problems.append(f"on_change with {limits}: the last change was lost")
    calls = len(follower.stamps_ns)
    subscription.cancel()
    buffer.set_transform(sample(last_ns + S), "stress")
    if len(follower.stamps_ns) != calls or buffer.statistics()["waiters"]:
        follower.problems.append(f"on_change with {limits}: it goes on after its cancel()")
    return follower.problems


def follow_changes(seconds):
    """Do rounds for this many seconds, with and without limits of ages: what went wrong, and how many."""
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    rounds, problems, end_s = 0, [], time.monotonic() + seconds
    try:
        while not problems and time.monotonic() < end_s:
            for limits in ({}, {"max_age": 1e9}):
                problems += follow_once(**limits)
                rounds += 1
    finally:
        sys.setswitchinterval(interval_s)
    return problems, rounds
