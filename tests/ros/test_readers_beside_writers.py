# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Readers do not keep writers out of a buffer, and writers do not keep readers out."""

import numpy as np
import pytest
from calls_in_threads import repeated
from random_runs import times
from rclpy.duration import Duration
from times_and_transforms import S, at, transform
from waiting import DEADLINE_S, SLOWNESS, until

from bench.programs.serialized_template import Template

HOPS = 10
SAMPLES = 100
READERS = 4
TIMES = np.linspace(S, S + (SAMPLES - 1) * 10**7, 1_000_000).astype(np.int64)  # of one vector lookup
LOOKUPS = 10_000
MANY = 10_000  # transforms of one message, which are inserted without a pause
MESSAGES = 300  # of these


@pytest.fixture
def buffer(tf2_ros):
    """A buffer with a chain of HOPS frames, from map to frame10."""
    buffer = tf2_ros.Buffer(Duration(seconds=10))
    chain = ["map", *(f"frame{i}" for i in range(1, HOPS + 1))]
    for parent, child in zip(chain, chain[1:], strict=False):
        for i in range(SAMPLES):
            buffer.set_transform(transform(parent, child, ns=S + i * 10**7), "x")
    return buffer


def taken(buffer):
    return buffer.statistics()["taken"]


@pytest.mark.repeated
def test_no_message_is_lost_beside_readers_that_never_pause(tf2_ros, buffer, node, flood):
    messages, before = times(60, 1000), taken(buffer)
    with tf2_ros.TransformListener(buffer, node) as listener:
        assert listener.receives
        with repeated(*[lambda: buffer.lookup_transforms("map", f"frame{HOPS}", TIMES)] * READERS):
            flood(int(100 / SLOWNESS), 1, messages).communicate(timeout=3 * DEADLINE_S)
        until(lambda: taken(buffer) == before + messages)


def test_lookups_return_while_a_thread_inserts_large_messages(buffer):
    template, stamps = Template(MANY), iter(range(S, 2 * S))
    inserted = []

    def insert():
        inserted.append(buffer.set_transforms_cdr(template.message(next(stamps), 0.0), "x"))

    with repeated(insert):
        until(lambda: inserted)
        for _ in range(LOOKUPS):
            buffer.lookup_transform("map", f"frame{HOPS}", at(1.5))
        before = len(inserted)
        until(lambda: len(inserted) > before)
    assert set(inserted) == {MANY}
