"""Distributions of durations in constant memory."""

import math
import threading

LEAST_S, STEP, BINS = 1e-6, 1.02, 1000  # up to 400 s, to 2 %


class Latencies:
    """Durations, from any threads."""

    def __init__(self):
        self._bins = [0] * BINS
        self._lock = threading.Lock()
        self.count = 0
        self.largest_s = 0.0

    def clear(self):
        with self._lock:
            self._bins = [0] * BINS
            self.count = 0
            self.largest_s = 0.0

    def add(self, seconds):
        place = int(math.log(max(seconds, LEAST_S) / LEAST_S) / math.log(STEP))
        with self._lock:
            self._bins[min(place, BINS - 1)] += 1
            self.count += 1
            self.largest_s = max(self.largest_s, seconds)

    def percentile(self, percent):
        """In seconds; NaN where there is none."""
        rank, seen = percent / 100 * self.count, 0
        for place, count in enumerate(self._bins):
            seen += count
            if count and seen >= rank:
                return min(LEAST_S * STEP ** (place + 1), self.largest_s)
        return math.nan

    def summary(self):
        """Their number, and percentiles in seconds."""
        return {
            "count": self.count,
            **{str(percent): self.percentile(percent) for percent in (50, 90, 99, 99.9)},
            "largest": self.largest_s,
        }
