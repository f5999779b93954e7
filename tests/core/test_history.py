"""One frame's history against a plain list that is searched from end to end."""

import bisect

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from making import at_ns, transform, translation
from ros_optional import Duration

pytestmark = pytest.mark.ours

CACHE_NS = 1000


class PlainHistory:
    """What behaviour is asked of the ring, in the slowest and shortest way."""

    def __init__(self):
        self.samples = []  # (stamp, parent, x), by stamp, equal ones by arrival

    def insert(self, stamp, parent, x):
        if self.samples:
            horizon = self.samples[-1][0] - CACHE_NS
            self.samples = [s for s in self.samples if s[0] >= horizon]
            if stamp < horizon:
                return
        if (stamp, parent, x) not in self.samples:
            self.samples.insert(
                bisect.bisect_right(self.samples, stamp, key=lambda s: s[0]), (stamp, parent, x)
            )

    def at(self, time):
        """(parent, x), or None where the history does not answer."""
        if not self.samples:
            return None
        if time == 0 or time == self.samples[-1][0]:
            return self.samples[-1][1:]
        if time == self.samples[0][0]:
            return self.samples[0][1:]
        if not self.samples[0][0] < time < self.samples[-1][0]:
            return None
        i = bisect.bisect_right(self.samples, time, key=lambda s: s[0])
        (t0, p0, x0), (t1, p1, x1) = self.samples[i - 1], self.samples[i]
        if p0 != p1:
            return p0, x0
        return p0, x0 + (time - t0) / (t1 - t0) * (x1 - x0)


def build(tf2_py):
    buffer = tf2_py.BufferCore(Duration(nanoseconds=CACHE_NS))
    # Known before the history begins, and in no other tree than their own.
    for name in ("left", "right"):
        buffer.set_transform_static(transform(f"root_of_{name}", name), "x")
    return buffer, PlainHistory()


insert = st.tuples(st.integers(1, 3000), st.sampled_from(["left", "left", "right"]), st.integers(0, 3))


@settings(max_examples=150, deadline=None)
@given(st.lists(insert, max_size=60))
def test_any_order_of_arrival(tf2_py, inserts):
    buffer, plain = build(tf2_py)
    for stamp, parent, x in inserts:
        buffer.set_transform(transform(parent, "cup", ns=stamp, xyz=(x, 0, 0)), "x")
        plain.insert(stamp, parent, x)
        buffer._self_check()
    # Two static samples are not part of the history.
    buffer_samples = buffer.statistics()["samples"] - 2
    assert buffer_samples == len(plain.samples)
    edges = {s[0] for s in plain.samples}
    for time in sorted({t + d for t in edges for d in (-1, 0, 1)} | {0}):
        want = plain.at(time) if time >= 0 else None
        for parent in ("left", "right"):
            if want is not None and want[0] == parent:
                got = buffer.lookup_transform_core(parent, "cup", at_ns(time))
                assert translation(got)[0] == pytest.approx(want[1], abs=1e-9)
            elif time > 0:
                assert not buffer.can_transform_core(parent, "cup", at_ns(time))[0]


@pytest.mark.parametrize("spread", ["even", "bursts", "squares"])
def test_every_place_of_a_long_history_is_found(tf2_py, spread):
    stamps = {
        "even": range(10, 5010, 5),
        "bursts": [1000 * (i // 50) + i % 50 + 1 for i in range(1000)],
        "squares": [i * i + 1 for i in range(1000)],
    }[spread]
    buffer = tf2_py.BufferCore(Duration(seconds=10))
    for i, stamp in enumerate(stamps):
        buffer.set_transform(transform("map", "odom", ns=stamp, xyz=(i, 0, 0)), "x")
    buffer._self_check()
    stamps = list(stamps)
    for i, stamp in enumerate(stamps):
        assert translation(buffer.lookup_transform_core("map", "odom", at_ns(stamp)))[0] == i
        if i and stamp - stamps[i - 1] > 1:
            between = translation(buffer.lookup_transform_core("map", "odom", at_ns(stamp - 1)))[0]
            assert i - 1 < between < i


def test_a_sliding_window_uses_bounded_memory(tf2_py):
    buffer = tf2_py.BufferCore(Duration(nanoseconds=100))
    sizes = set()
    for stamp in range(1, 5000):
        buffer.set_transform(transform("map", "odom", ns=stamp), "x")
        if stamp > 1000:
            sizes.add(buffer.statistics()["bytes"])
            assert buffer.statistics()["samples"] == 102  # pruning looks at the newest before the insert
    assert len(sizes) == 1


def test_a_ring_that_a_burst_left_mostly_empty_shrinks(tf2_py):
    buffer = tf2_py.BufferCore(Duration(nanoseconds=10_000))
    for stamp in range(1, 10_001):
        buffer.set_transform(transform("map", "odom", ns=stamp), "x")
    after_burst = buffer.statistics()["bytes"]
    for i in range(1, 60_000):
        buffer.set_transform(transform("map", "odom", ns=10_000 + i * 1000), "x")
    buffer._self_check()
    assert buffer.statistics()["samples"] < 20
    assert buffer.statistics()["bytes"] < after_burst / 10


def test_a_ring_shrinks_by_half_after_as_many_inserts_as_it_has_slots(tf2_py):
    buffer = tf2_py.BufferCore(Duration(nanoseconds=1000))
    for stamp in range(1, 1001):
        buffer.set_transform(transform("map", "odom", ns=stamp), "x")
    sizes = [buffer.statistics()["bytes"]]
    for i in range(2, 4000):
        buffer.set_transform(transform("map", "odom", ns=i * 1000), "x")
        sizes.append(buffer.statistics()["bytes"])
    at = [i for i in range(1, len(sizes)) if sizes[i] != sizes[i - 1]]
    # Samples are of 72 bytes.
    halves = [(sizes[i - 1] - sizes[i]) / 72 for i in at]
    assert len(at) >= 4
    assert all(size > 0 for size in halves)
    for before, after, half in zip([0, *at], at, halves, strict=False):
        assert abs(after - before - 2 * half) <= 4
    assert sizes[-1] - sizes[0] + sum(halves) * 72 == 0
    buffer._self_check()


def test_a_short_history_keeps_its_first_ring(tf2_py):
    buffer = tf2_py.BufferCore(Duration(nanoseconds=1))
    sizes = set()
    for i in range(1, 200):
        buffer.set_transform(transform("map", "odom", ns=i * 1000), "x")
        buffer._self_check()
        sizes.add(buffer.statistics()["bytes"])
    assert len(sizes) == 1


@pytest.mark.parametrize("step", [1, -1], ids=["in order", "each late"])
def test_a_full_ring_takes_72_bytes_a_sample(tf2_py, step):
    small, large = tf2_py.BufferCore(Duration(seconds=10)), tf2_py.BufferCore(Duration(seconds=10))
    small.set_transform(transform("map", "odom", ns=1), "x")
    per_sample = []
    for count in range(1, 3000):
        large.set_transform(transform("map", "odom", ns=3000 + step * count), "x")
        if count > 100:
            per_sample.append((large.statistics()["bytes"] - small.statistics()["bytes"]) / count)
    assert min(per_sample) <= 72
    assert max(per_sample) <= 110
