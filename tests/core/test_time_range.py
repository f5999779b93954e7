"""The times for which two frames can be looked up; test_buffer_beside_model.py asks random buffers."""

import math

import pytest
from making_objects import S, at_ns, transform

from tf2_py import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
)

pytestmark = pytest.mark.ours

ALWAYS = (0, 2**31 * S - 1)  # to the latest stamp of a message


def insert(buffer, parent, child, *stamps):
    buffer.set_transforms([transform(parent, child, ns=ns) for ns in stamps], "x")


def insert_static(buffer, parent, child):
    buffer.set_transform_static(transform(parent, child), "x")


@pytest.fixture
def buffer():
    buffer = BufferCore(math.inf)
    insert(buffer, "map", "odom", 20, 30, 90)
    insert(buffer, "odom", "base", 10, 50)
    insert(buffer, "odom", "gate", 40, 60)
    insert_static(buffer, "base", "camera")
    insert_static(buffer, "base", "lidar")
    return buffer


@pytest.mark.parametrize(
    ("frames", "wanted"),
    [
        (("map", "odom"), (20, 90)),
        (("map", "camera"), (20, 50)),
        (("odom", "camera"), (10, 50)),
        (("gate", "camera"), (40, 50)),
        (("lidar", "camera"), ALWAYS),
        (("base", "camera"), ALWAYS),
        (("base", "base"), ALWAYS),
    ],
)
def test_it_is_common_to_all_frames_that_move_on_the_path(buffer, frames, wanted):
    target, source = frames
    assert buffer.time_range(target, source) == buffer.time_range(source, target) == wanted


def test_both_ends_have_an_answer_and_nothing_beyond_them(buffer):
    first, last = buffer.time_range("map", "camera")
    assert buffer.lookup_transforms("map", "camera", range(first, last + 1))[0].shape == (31, 3)
    for beyond in (first - 1, last + 1):
        assert not buffer.can_transform_core("map", "camera", at_ns(beyond))[0]
    assert last == buffer.get_latest_common_time("map", "camera").nanoseconds


def test_without_a_frame_that_moves_every_time_of_a_message_has_an_answer(buffer):
    first, last = buffer.time_range("lidar", "camera")
    for ns in (first, 1, last):
        assert buffer.can_transform_core("lidar", "camera", at_ns(ns))[0]
    with pytest.raises(OverflowError):
        buffer.can_transform_core("lidar", "camera", at_ns(last + 1))


def test_a_single_sample_is_a_range_of_one_time(buffer):
    insert(buffer, "odom", "cup", 45)
    assert buffer.time_range("map", "cup") == (45, 45)


@pytest.mark.parametrize("parent", ["map", "odom", "base"])
def test_a_frame_that_changes_its_parent_is_followed_through_all_of_them(buffer, parent):
    insert(buffer, "base", "cup", 20, 35)
    insert(buffer, parent, "cup", 36, 48)
    assert buffer.time_range("map", "cup") == (20, 48)


def test_times_with_a_parent_in_another_tree_are_not_part_of_it(buffer):
    insert(buffer, "base", "cup", 20, 25)
    insert(buffer, "elsewhere", "cup", 30, 35)
    insert(buffer, "base", "cup", 40, 45)
    assert buffer.time_range("map", "cup") == (40, 45)


@pytest.mark.parametrize(
    ("frames", "error", "text"),
    [
        (
            ("map", "kitchen"),
            ConnectivityException,
            "no.*between 'map' and 'kitchen'.*the root of kitchen is house",
        ),
        (
            ("map", "cup"),
            ExtrapolationException,
            r"the oldest sample of cup \(parent base\) .* is 0\.000000020 s too new",
        ),
        (
            ("map", "camra"),
            LookupException,
            r'"camra" passed to time_range argument source_frame .*\[camera\]',
        ),
        (("mop", "mop"), LookupException, r'"mop" passed to time_range argument target_frame .*\[map\]'),
        (("/map", "base"), InvalidArgumentException, '"/map" passed to time_range'),
        (("map", ""), InvalidArgumentException, '"" passed to time_range argument source_frame'),
        (("map", None), TypeError, "source_frame: expected a str, got NoneType"),
        (("map", "a"), LookupException, "contains a loop"),
    ],
)
def test_frames_without_a_common_time_raise_what_their_lookup_raises(buffer, frames, error, text):
    insert(buffer, "house", "kitchen", 1)
    insert(buffer, "base", "cup", 70, 80)
    insert(buffer, "a", "b", 1)
    insert(buffer, "b", "a", 1)
    with pytest.raises(error, match=text):
        buffer.time_range(*frames)


def test_a_cleared_buffer_has_no_path(buffer):
    buffer.clear()
    with pytest.raises(ConnectivityException):
        buffer.time_range("map", "camera")
    assert buffer.time_range("lidar", "camera") == ALWAYS


def test_the_stamp_0_belongs_to_it(buffer):
    insert(buffer, "dock", "cart", 0, 5)
    assert buffer.time_range("dock", "cart") == (0, 5)


def test_a_walk_to_a_frame_above_the_path_that_has_no_data_there(buffer):
    """Which crashed: the parent of `base` was asked for a time before its samples."""
    insert(buffer, "odom", "cart", 3)
    insert(buffer, "odom", "camera", 0)
    insert(buffer, "map", "cart", 5)
    insert_static(buffer, "cart", "odom")  # odom is below its former child
    insert_static(buffer, "cart", "cup")
    assert buffer.get_latest_common_time("cup", "camera").nanoseconds == 0
    assert buffer.time_range("cup", "camera") == (0, 0)


def test_it_does_not_reach_across_times_at_which_the_tree_loops():
    buffer = BufferCore(math.inf)
    for link, ns in (("ba", 5), ("ab", 2), ("be", 8), ("eb", 7), ("be", 2)):
        insert(buffer, *link, ns)
    answers = [buffer.can_transform_core("e", "b", at_ns(ns))[0] for ns in range(2, 8)]
    assert answers == [1, 1, 1, 0, 1, 1]
    assert buffer.time_range("e", "b") == (6, 7)


def test_a_static_path_serves_before_a_loop_has_data():
    buffer = BufferCore(math.inf)
    insert_static(buffer, "e", "a")
    insert(buffer, "a", "d", 5)
    insert(buffer, "d", "e", 5)
    assert buffer.path("a", "e", at_ns(5)) == ["e", "d", "a"]
    assert buffer.path("a", "e", at_ns(4)) == ["e", "a"]
    assert buffer.time_range("a", "e") == (0, 5)
