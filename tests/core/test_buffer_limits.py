# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The limits of what a buffer holds: frames, bytes, authorities, samples of one stamp, time."""

import pytest
from messages_with_or_without_ros import Duration
from times_and_transforms import at, transform, translation

from tf2_py import BufferCore


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


def test_a_wrong_cache_time_is_refused_and_init_again_changes_nothing():
    buffer = with_pose()
    for wrong, error in (("10", TypeError), (object(), TypeError), (Duration(seconds=-1), ValueError)):
        with pytest.raises(error, match="^cache_time: expected "):
            buffer.__init__(wrong)
    assert answers(buffer)
