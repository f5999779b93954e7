# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The times for which two frames can be looked up; test_buffer_beside_model.py asks random buffers."""

import math

import pytest
from times_and_transforms import at_ns, transform

from tf2_py import (
    BufferCore,
)


def insert(buffer, parent, child, *stamps):
    buffer.set_transforms([transform(parent, child, ns=ns) for ns in stamps], "x")


def insert_static(buffer, parent, child):
    buffer.set_transform_static(transform(parent, child), "x")


@pytest.fixture
def buffer():
    buffer = BufferCore(math.inf)
    insert(buffer, "map", "odom", 20, 30, 90)
    insert(buffer, "odom", "base", 10, 50)
    insert(buffer, "odom", "gate", 40, 60)
    insert_static(buffer, "base", "camera")
    insert_static(buffer, "base", "lidar")
    return buffer


def test_without_a_frame_that_moves_every_time_of_a_message_has_an_answer(buffer):
    first, last = buffer.time_range("lidar", "camera")
    for ns in (first, 1, last):
        assert buffer.can_transform_core("lidar", "camera", at_ns(ns))[0]
    with pytest.raises(OverflowError):
        buffer.can_transform_core("lidar", "camera", at_ns(last + 1))


def test_a_walk_to_a_frame_above_the_path_that_has_no_data_there(buffer):
    """Which crashed: the parent of `base` was asked for a time before its samples."""
    insert(buffer, "odom", "cart", 3)
    insert(buffer, "odom", "camera", 0)
    insert(buffer, "map", "cart", 5)
    insert_static(buffer, "cart", "odom")  # odom is below its former child
    insert_static(buffer, "cart", "cup")
    assert buffer.get_latest_common_time("cup", "camera").nanoseconds == 0
    assert buffer.time_range("cup", "camera") == (0, 0)
