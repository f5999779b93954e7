# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The ticks of a loop."""

import random
import time

import pytest
from times_and_transforms import S

from tf2_ros_tools.common.pace import Pace


@pytest.mark.parametrize("rate", [0.01, 1.0, 30.0, 100_000.0, 1e300])
def test_missed_ticks_are_skipped_and_the_others_keep_their_times(rate, monkeypatch):
    generator = random.Random(rate)
    begin_ns = now_ns = due_ns = time.monotonic_ns()
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns)
    pace, period_ns = Pace(1.0 / rate), max(round(S / rate), 1)
    for _ in range(1000):
        now_ns += round(generator.expovariate(2.0) * period_ns)
        before_ns, due_ns = due_ns, now_ns + round(pace.next_s() * S)
        assert (due_ns - begin_ns) % period_ns == 0
        assert now_ns < due_ns <= max(before_ns, now_ns + period_ns)


def test_a_wait_is_never_longer_than_time_sleep_accepts():
    assert 0.0 < Pace(1e300).next_s() <= 1e9
