# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""In a history of many samples, the search finds each place."""

import pytest
from messages_with_or_without_ros import Duration
from times_and_transforms import at_ns, transform

from tf2_py import BufferCore

BURSTS = [1000 * (i // 50) + i % 50 + 1 for i in range(1000)]
SQUARES = [i * i + 1 for i in range(1000)]


@pytest.mark.parametrize("stamps", [BURSTS, SQUARES], ids=["bursts", "squares"])
def test_every_place_of_a_long_history_is_found(stamps):
    buffer = BufferCore(Duration(seconds=10))
    for i, stamp in enumerate(stamps):
        buffer.set_transform(transform(f"parent {i}", "odom", ns=stamp), "x")
    for i, stamp in enumerate(stamps):
        assert buffer.parent("odom", at_ns(stamp)) == f"parent {i}"
        if i and stamp - stamps[i - 1] > 1:
            assert buffer.parent("odom", at_ns(stamp - 1)) == f"parent {i - 1}"
