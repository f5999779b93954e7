"""What a buffer holds: its limits, the memory that it takes, and its table of names."""

import random

import pytest
from making_objects import at, at_ns, transform, translation
from messages_with_or_without_ros import Duration

from tf2_py import BufferCore

pytestmark = pytest.mark.ours


def with_pose(**limits):
    buffer = BufferCore(**limits)
    buffer.set_transform(transform("map", "base", 1), "test")
    return buffer


def answers(buffer, seconds=1):
    buffer._self_check()
    return buffer.can_transform_core("map", "base", at(seconds)) == (1, "")


class TestLimits:
    """What exceeds them is refused and counted, and lookups of what is held still answer."""

    def test_of_frames(self):
        buffer = with_pose(max_frames=100)
        assert buffer.set_transforms([transform("map", f"frame {i}", 1) for i in range(300)], "test") == 98
        statistics = buffer.statistics()
        assert (statistics["frames"], statistics["refused"]["too_many_frames"]) == (100, 202)
        assert answers(buffer)
        buffer.set_transform(transform("map", "base", 2), "test")
        assert answers(buffer, 2)

    def test_of_the_bytes_of_samples(self):
        buffer = with_pose(max_bytes=100_000)
        samples = [transform("map", "base", ns=10**9 + i) for i in range(1, 5000)]
        taken = sum(buffer.set_transforms([one], "test") for one in samples)
        statistics = buffer.statistics()
        assert 500 < taken < 2000
        assert statistics["refused"]["too_many_bytes"] == 4999 - taken
        assert statistics["bytes"] <= 100_000
        assert answers(buffer)
        # Time goes on: what is too old makes room.
        buffer.set_transform(transform("map", "base", 30), "test")
        assert answers(buffer, 30)

    def test_of_the_bytes_of_names(self):
        buffer = with_pose(max_bytes=100_000)
        for i in range(200):
            buffer.set_transform(transform("map", f"{i}" + 5000 * "x", 1), "test")
        statistics = buffer.statistics()
        assert statistics["refused"]["too_many_bytes"] > 150
        assert statistics["bytes"] < 250_000
        assert answers(buffer)

    def test_beyond_which_authorities_lose_their_name_alone(self):
        buffer = with_pose(max_frames=10, max_bytes=100_000)
        for i in range(100):
            buffer.set_transform(transform("map", "base", 1 + i / 10), f"authority {i}")
        assert buffer.statistics()["taken"] == 101
        assert "(too many authorities)" in buffer.all_frames_as_yaml()
        assert buffer.statistics()["bytes"] < 100_000

    @pytest.mark.parametrize("name", ["max_frames", "max_bytes"])
    def test_that_the_environment_sets_for_programs_that_do_not(self, name, monkeypatch):
        monkeypatch.setenv(f"TF2_ROS_CYTHON_{name.upper()}", "nonsense")
        with pytest.raises(ValueError, match=name.upper()):
            BufferCore()
        BufferCore(**{name: 1000})
        monkeypatch.setenv(f"TF2_ROS_CYTHON_{name.upper()}", "1000")
        BufferCore()
        for wrong in (0, -1, 1 << 63):
            with pytest.raises(ValueError, match=f"{name}: expected a number above 0"):
                BufferCore(**{name: wrong})
        with pytest.raises(TypeError, match=f"{name}: expected an int"):
            BufferCore(**{name: "1000"})

    def test_of_the_samples_of_one_stamp(self):
        buffer = BufferCore()
        for i in range(10_000):
            buffer.set_transform(transform("map", "base", 1, (i, 0, 0)), "test")
        assert buffer.statistics()["samples"] < 100
        assert translation(buffer.lookup_transform_core("map", "base", at(1)))[0] == 9999
        # Once it is the oldest stamp of several, its first sample answers, as in tf2.
        buffer.set_transform(transform("map", "base", 2), "test")
        assert translation(buffer.lookup_transform_core("map", "base", at(1)))[0] == 0


class TestMemory:
    def test_a_sliding_window_uses_bounded_memory(self):
        buffer = BufferCore(Duration(nanoseconds=100))
        sizes = set()
        for stamp in range(1, 5000):
            buffer.set_transform(transform("map", "odom", ns=stamp), "x")
            if stamp > 1000:
                sizes.add(buffer.statistics()["bytes"])
                assert buffer.statistics()["samples"] == 102  # pruning looks at the newest before the insert
        assert len(sizes) == 1

    def test_a_ring_that_a_burst_left_mostly_empty_shrinks(self):
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
    def test_a_full_ring_takes_72_bytes_a_sample(self, step):
        small, large = BufferCore(Duration(seconds=10)), BufferCore(Duration(seconds=10))
        small.set_transform(transform("map", "odom", ns=1), "x")
        per_sample = []
        for count in range(1, 3000):
            large.set_transform(transform("map", "odom", ns=3000 + step * count), "x")
            if count > 100:
                per_sample.append((large.statistics()["bytes"] - small.statistics()["bytes"]) / count)
        assert min(per_sample) <= 72
        assert max(per_sample) <= 110


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


@pytest.mark.parametrize("kind", ["of one letter", "random", "long"])
def test_names_of_any_kind_lie_apart(kind):
    random.seed(1)
    names = {
        "of one letter": lambda: ["x" * size for size in range(1, 1000)],
        "random": lambda: [f"{random.getrandbits(64):016x}" for _ in range(20_000)],
        "long": lambda: [f"{'x' * 2000}{i}" for i in range(1000)],
    }[kind]()
    buffer = BufferCore()
    assert buffer.set_transforms([transform("map", name, 1) for name in names], "x") == len(names)
    buffer._self_check()
    assert all(buffer._frameExists(name) for name in names)
    assert not any(buffer._frameExists(name + "y") for name in names[:-1])
    assert buffer._getFrameStrings() == [names[0], "map", *names[1:]]
