# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A lookup at many times, beside threads that write, sees whole samples alone."""

import random
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from messages_with_or_without_ros import Duration, Time
from times_and_transforms import S, transform

from tf2_py import BufferCore, TransformException

pytestmark = pytest.mark.ours

STEP = 10_000_000  # ns


def telling(stamp_ns, parent, child):
    # Its number encodes its stamp: whatever is interpolated between whole samples gives the time back.
    return transform(parent, child, ns=stamp_ns, xyz=(stamp_ns / S, 0, 0))


def advance(buffer, links, rounds, rng):
    # Forward, with late samples, samples of one stamp and long pauses that prune nearly everything.
    now = S
    for _ in range(rounds):
        now += STEP * (1 if rng.random() < 0.999 else 200)
        for link in links:
            buffer.set_transform(telling(now, *link), "x")
            if rng.random() < 0.2:
                buffer.set_transform(telling(now - rng.randrange(S), *link), "x")
        if rng.random() < 0.001:
            buffer.clear()


@pytest.mark.parametrize("looped", [False, True])
def test_no_vector_lookup_sees_half_of_a_sample(looped):
    buffer = BufferCore(Duration(seconds=1.0))
    done = threading.Event()
    answers = []
    if looped:
        # Each time is then looked up on its own.
        buffer.set_transform(transform("chicken", "egg", 1), "x")
        buffer.set_transform(transform("egg", "chicken", 1), "x")

    def read():
        rng = np.random.default_rng(0)
        answered = 0
        while not done.is_set():
            try:
                latest = buffer.lookup_transform_core("map", "base", Time()).header.stamp
            except TransformException:
                continue
            newest = latest.sec * S + latest.nanosec
            times = newest - rng.integers(0, S, 3000)
            translations, _ = buffer.lookup_transforms("map", "base", times, on_missing="nan")
            found = ~np.isnan(translations[:, 0])
            expected = times[found] * (2 / S)
            assert np.all(np.abs(translations[found, 0] - expected) < 1e-6)
            answered += int(found.sum())
        answers.append(answered)

    def write():
        try:
            advance(buffer, [("map", "odom"), ("odom", "base")], 15000, random.Random(1))
        finally:
            done.set()

    with ThreadPoolExecutor() as threads:
        for ended in [threads.submit(work) for work in (read, read, read, write)]:
            ended.result()
    buffer._self_check()
    assert sum(answers) > 0


def test_a_limit_knows_its_frame_while_new_frames_appear():
    buffer = BufferCore()
    buffer.set_transform(telling(S, "map", "base"), "x")
    done = threading.Event()

    def grow():
        for i in range(200_000):
            if done.is_set():
                return
            buffer.set_transform(telling(S, "map", f"new_{i}"), "x")

    with ThreadPoolExecutor() as threads:
        growing = threads.submit(grow)
        try:
            for _ in range(100):
                # Without its limit, a time after the only sample has no answer.
                buffer.lookup_transforms("map", "base", np.full(5000, 2 * S), tolerance={"base": 1.0})
        finally:
            done.set()
        growing.result()
