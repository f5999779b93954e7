# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The ticks of a loop."""

import random

import pytest
from times_and_transforms import S

from tf2_ros_tools.common.pace import Pace


@pytest.mark.parametrize("rate", [1e-300, 0.01, 1.0, 30.0, 100_000.0, 1e300])
def test_missed_ticks_are_skipped_and_the_others_keep_their_times(rate):
    generator = random.Random(rate)
    pace = Pace(1.0 / rate)
    begin_ns, period_ns = pace.due_ns, max(round(min(1.0 / rate, 1e9) * S), 1)
    now_ns = begin_ns
    for _ in range(1000):
        now_ns += round(generator.expovariate(2.0) * period_ns)
        before_ns = pace.due_ns
        pace.advance(now_ns)
        assert (pace.due_ns - begin_ns) % period_ns == 0
        assert now_ns < pace.due_ns <= max(before_ns, now_ns + period_ns)
    assert 0.0 < Pace(1.0 / rate).next_s() <= period_ns / S
