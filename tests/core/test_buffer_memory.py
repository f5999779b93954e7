# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The memory that the samples of a buffer take."""

import pytest
from messages_with_or_without_ros import Duration
from times_and_transforms import transform

from tf2_py import BufferCore


def test_a_sliding_window_uses_bounded_memory():
    buffer = BufferCore(Duration(nanoseconds=100))
    sizes = set()
    for stamp in range(1, 5000):
        buffer.set_transform(transform("map", "odom", ns=stamp), "x")
        if stamp > 1000:
            sizes.add(buffer.statistics()["bytes"])
            assert buffer.statistics()["samples"] == 102  # pruning looks at the newest before the insert
    assert len(sizes) == 1


def test_a_ring_that_a_burst_left_mostly_empty_shrinks():
    buffer = BufferCore(Duration(nanoseconds=1000))
    for stamp in range(1, 1001):
        buffer.set_transform(transform("map", "odom", ns=stamp), "x")
    after_burst = buffer.statistics()["bytes"]
    for i in range(2, 4000):
        buffer.set_transform(transform("map", "odom", ns=i * 1000), "x")
    buffer._self_check()
    assert buffer.statistics()["samples"] < 20
    assert buffer.statistics()["bytes"] < after_burst / 5


@pytest.mark.parametrize("step", [1, -1], ids=["in order", "each late"])
def test_a_full_ring_takes_72_bytes_a_sample(step):
    small, large = BufferCore(Duration(seconds=10)), BufferCore(Duration(seconds=10))
    small.set_transform(transform("map", "odom", ns=1), "x")
    per_sample = []
    for count in range(1, 3000):
        large.set_transform(transform("map", "odom", ns=3000 + step * count), "x")
        if count > 100:
            per_sample.append((large.statistics()["bytes"] - small.statistics()["bytes"]) / count)
    assert min(per_sample) <= 72
    assert max(per_sample) <= 110
