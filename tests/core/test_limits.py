"""The limits of a buffer: what exceeds them is refused, and lookups of what it holds still answer."""

import pytest
from making import at, transform

from tf2_py import BufferCore

pytestmark = pytest.mark.ours


def with_pose(**limits):
    buffer = BufferCore(**limits)
    buffer.set_transform(transform("map", "base", 1), "test")
    return buffer


def answers(buffer):
    buffer._self_check()
    return buffer.can_transform_core("map", "base", at(1)) == (1, "")


def test_frames_beyond_the_limit_are_refused_and_counted():
    buffer = with_pose(max_frames=100)
    assert buffer.set_transforms([transform("map", f"frame {i}", 1) for i in range(300)], "test") == 98
    statistics = buffer.statistics()
    assert (statistics["frames"], statistics["refused"]["too_many_frames"]) == (100, 202)
    assert answers(buffer)
    buffer.set_transform(transform("map", "base", 2), "test")
    assert buffer.can_transform_core("map", "base", at(2)) == (1, "")


def test_samples_beyond_the_limit_of_bytes_are_refused_and_counted():
    buffer = with_pose(max_bytes=100_000)
    taken = sum(
        buffer.set_transforms([transform("map", "base", ns=10**9 + i)], "test") for i in range(1, 5000)
    )
    statistics = buffer.statistics()
    assert 500 < taken < 2000
    assert statistics["refused"]["too_many_bytes"] == 4999 - taken
    assert statistics["bytes"] <= 100_000
    assert answers(buffer)


def test_names_beyond_the_limit_of_bytes_are_refused_and_counted():
    buffer = with_pose(max_bytes=100_000)
    for i in range(200):
        buffer.set_transform(transform("map", f"{i}" + 5000 * "x", 1), "test")
    statistics = buffer.statistics()
    assert statistics["refused"]["too_many_bytes"] > 150
    assert statistics["bytes"] < 250_000
    assert answers(buffer)


def test_authorities_beyond_the_limits_lose_their_name_alone():
    buffer = with_pose(max_frames=10, max_bytes=100_000)
    for i in range(100):
        buffer.set_transform(transform("map", "base", 1 + i / 10), f"authority {i}")
    assert buffer.statistics()["taken"] == 101
    assert "(too many authorities)" in buffer.all_frames_as_yaml()
    assert buffer.statistics()["bytes"] < 100_000


@pytest.mark.parametrize("name", ["max_frames", "max_bytes"])
def test_the_environment_sets_limits_for_programs_that_do_not(name, monkeypatch):
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


def test_samples_of_one_stamp_are_few_however_many_come():
    buffer = BufferCore()
    for i in range(10_000):
        buffer.set_transform(transform("map", "base", 1, (i, 0, 0)), "test")
    assert buffer.statistics()["samples"] < 100
    last = buffer.lookup_transform_core("map", "base", at(1))
    assert last.transform.translation.x == 9999
    # Once it is the oldest stamp of several, its first sample answers, as in tf2.
    buffer.set_transform(transform("map", "base", 2), "test")
    assert buffer.lookup_transform_core("map", "base", at(1)).transform.translation.x == 0


def test_time_goes_on_in_a_buffer_that_is_full():
    buffer = with_pose(max_bytes=50_000)
    for i in range(5000):
        buffer.set_transform(transform("map", "base", ns=10**9 + i), "test")
    buffer.set_transform(transform("map", "base", 30), "test")
    assert buffer.can_transform_core("map", "base", at(30)) == (1, "")
