# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The limits of what a buffer holds: frames, bytes, authorities, samples of one stamp, time."""

import re

import pytest
from interposed_libraries import output_with_library
from messages_with_or_without_ros import Duration
from times_and_transforms import S, at, transform, translation

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
        for i in range(1, 5000):
            assert buffer.set_transforms([transform("map", "base", ns=S + i)], "test") == 1
            assert buffer.frames()["base"].newest_ns == S + i
        statistics = buffer.statistics()
        assert 500 < statistics["samples"] == 5000 - statistics["displaced"] < 2000
        assert statistics["bytes"] <= 100_000
        assert answers(buffer, 1.000004)
        oldest_ns = buffer.frames()["base"].oldest_ns
        buffer.set_transform(transform("map", "base", ns=oldest_ns + 5, xyz=(1, 0, 0)), "late")
        assert translation(buffer.lookup_transform_core("map", "base", oldest_ns + 5))[0] == 1
        assert buffer.frames()["base"].oldest_ns == oldest_ns + 1
        assert buffer.set_transforms([transform("map", "base", ns=oldest_ns)], "older than all") == 0
        assert buffer.statistics()["refused"]["too_many_bytes"] == 1
        assert answers(buffer, 1.000004)

    def test_of_bytes_that_other_frames_have_reached(self):
        buffer = with_pose(max_bytes=200_000)
        names = [f"{i} " + 100 * "x" for i in range(2000)]
        taken = buffer.set_transforms([transform("map", name) for name in names], "other", True)
        assert buffer.statistics()["refused"]["too_many_bytes"] == 2000 - taken > 0
        for i in range(1, 500):
            assert buffer.set_transforms([transform("map", "base", ns=S + i)], "test") == 1
            assert buffer.frames()["base"].newest_ns == S + i
        assert buffer.frames()["base"].count == 8
        assert answers(buffer, 1.000000499)

    def test_of_bytes_is_logged_once_and_then_every_ten_minutes(self, tmp_path):
        where = {"program": "full_buffer_for_an_hour", "RCUTILS_LOGGING_USE_STDOUT": "1"}
        lines = output_with_library("time_of_day", tmp_path, **where).splitlines()
        text = "has reached max_bytes, 20000 bytes: each new transform displaces the oldest one of its frame"
        assert all(text in line for line in lines)
        counts = [int(re.search(r"(\d+) so far", line)[1]) for line in lines]
        assert counts == [1 + 600 * i for i in range(len(lines))]
        assert len(lines) == 6

    def test_of_the_bytes_of_names(self):
        buffer = with_pose(max_bytes=100_000)
        for i in range(200):
            buffer.set_transform(transform("map", f"{i}" + 5000 * "x", 1), "test")
        statistics = buffer.statistics()
        assert statistics["refused"]["too_many_bytes"] > 150
        assert statistics["bytes"] < 250_000
        assert answers(buffer)

    @pytest.mark.parametrize("size", [0, 100])
    def test_of_bytes_counts_the_tables_of_names(self, size):
        buffer = BufferCore(max_bytes=200_000)
        for i in range(3000):
            buffer.set_transforms([transform("map", f"{i}" + size * "x", 1)], f"authority {i}")
            assert buffer.statistics()["bytes"] <= 200_000
        assert buffer.statistics()["refused"]["too_many_bytes"] > 0
        buffer._self_check()

    def test_beyond_which_authorities_lose_their_name_alone(self):
        buffer, names = with_pose(max_frames=10, max_bytes=100_000), []
        for i in range(100):
            buffer.set_transform(transform("map", "base", 1 + i / 10), f"authority {i}")
            names += re.findall("broadcaster: '(.*)'", buffer.all_frames_as_yaml())
        assert buffer.statistics()["taken"] == 101
        # That of the first pose is another one.
        assert names == [f"authority {i}" for i in range(9)] + ["(too many authorities)"] * 91
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
