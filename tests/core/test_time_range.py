"""The times for which two frames can be looked up in each other."""

import itertools
import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from making import S, at_ns, stamp_ns, transform

from tf2_py import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
)

pytestmark = pytest.mark.ours

END = 12  # ns: all stamps of random buffers are below it
LATEST = at_ns(0)
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
            "no.*between 'map' and 'kitchen'.*that of kitchen is house",
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


FRAMES = ("a", "b", "c", "d", "e")
links = st.sampled_from(list(itertools.combinations(FRAMES, 2)))  # without loops


@given(
    moving=st.lists(st.tuples(links, st.integers(1, END - 1)), max_size=25),
    fixed=st.lists(links, max_size=2),
)
@example([("ac", 3), ("bc", 3), ("ac", 5)], [])
@example([("ac", 2), ("ac", 3), ("bc", 3), ("ac", 3), ("ac", 5)], ["ab"])
def test_it_is_what_lookups_at_every_time_find(moving, fixed):
    buffer = BufferCore(math.inf)
    for (parent, child), ns in moving:
        insert(buffer, parent, child, ns)
    for parent, child in fixed:
        insert_static(buffer, parent, child)
    for target in filter(buffer.__contains__, FRAMES):
        for source in filter(buffer.__contains__, FRAMES):
            assert found(buffer, target, source) == wanted(buffer, target, source)


def found(buffer, target, source):
    try:
        return buffer.time_range(target, source)
    except TransformException as error:
        return type(error)


def wanted(buffer, target, source):
    try:
        last = stamp_ns(buffer.lookup_transform_core(target, source, LATEST))
    except TransformException as error:
        return type(error)
    answers = [buffer.can_transform_core(target, source, at_ns(ns))[0] for ns in range(END + 1)]
    if answers[END]:  # nothing moves
        return ALWAYS
    first = last
    while first > 1 and answers[first - 1]:
        first -= 1
    return first, last
