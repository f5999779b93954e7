"""The history of one frame: finding samples, and memory. The model holds what it answers (test_model.py)."""

import pytest
from making import at_ns, transform, translation
from ros_optional import Duration

pytestmark = pytest.mark.ours


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
    buffer = tf2_py.BufferCore(Duration(nanoseconds=1000))
    for stamp in range(1, 1001):
        buffer.set_transform(transform("map", "odom", ns=stamp), "x")
    after_burst = buffer.statistics()["bytes"]
    for i in range(2, 4000):
        buffer.set_transform(transform("map", "odom", ns=i * 1000), "x")
    buffer._self_check()
    assert buffer.statistics()["samples"] < 20
    assert buffer.statistics()["bytes"] < after_burst / 5


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
