# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Time the ticks of a loop."""

import time

S = 1_000_000_000
LONGEST_PERIOD_S = 1e9  # about what time.sleep accepts, in seconds


class Pace:
    """
    The ticks of a loop, at a constant rate from now on.

    Missed ticks are skipped, whether the process was stopped, its output had to wait for a reader, or the
    loop is slower than the rate. The others keep their times.

    :param period_s: from one tick to the next, in seconds.
    """

    def __init__(self, period_s: float) -> None:
        self._period_ns = max(round(min(period_s, LONGEST_PERIOD_S) * S), 1)
        self._due_ns = time.monotonic_ns()  # when the next tick is due

    def next_s(self) -> float:
        """Go on to the next tick; return how long to wait for it, in seconds, which is above 0."""
        now_ns = time.monotonic_ns()
        missed = max(now_ns - self._due_ns, -1) // self._period_ns + 1
        self._due_ns += missed * self._period_ns
        return (self._due_ns - now_ns) / S
