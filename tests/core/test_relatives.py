"""The parent and the children of a frame, and the path between two."""

import pytest
from making import S, at, transform

pytestmark = pytest.mark.ours


@pytest.fixture
def buffer(tf2_py):
    buffer = tf2_py.BufferCore()
    for parent, child, seconds in (
        ("map", "odom", (1, 5)),
        ("odom", "base", (2, 4)),
        ("base", "cup", (2,)),
        ("gripper", "cup", (4,)),
    ):
        for second in seconds:
            buffer.set_transform(transform(parent, child, second), "x")
    buffer.set_transform_static(transform("base", "arm"), "x")
    buffer.set_transform_static(transform("arm", "gripper"), "x")
    return buffer


def test_the_parent_is_that_of_the_newest_sample_or_of_a_time(buffer):
    assert buffer.parent("cup") == "gripper"
    assert buffer.parent("cup", at(4)) == "gripper"
    assert buffer.parent("cup", 3 * S) == "base"
    assert buffer.parent("gripper", 77 * S) == "arm"


def test_a_root_and_a_time_without_data_have_none(buffer):
    assert buffer.parent("map") is None
    assert buffer.parent("odom", 6 * S) is None
    assert buffer.parent("odom", S // 2) is None


def test_children_are_those_of_the_newest_samples(buffer):
    assert buffer.children("base") == ["arm"]
    assert buffer.children("gripper") == ["cup"]
    assert buffer.children("cup") == []


def test_the_path_leads_from_the_source_over_the_common_ancestor(buffer):
    assert buffer.path("odom", "cup") == ["cup", "gripper", "arm", "base", "odom"]
    assert buffer.path("gripper", "odom") == ["odom", "base", "arm", "gripper"]
    assert buffer.path("cup", "map", at(3)) == ["map", "odom", "base", "cup"]
    assert buffer.path("arm", "arm") == ["arm"]


def test_what_has_no_path_raises_what_a_lookup_raises(tf2_py, buffer):
    buffer.set_transform_static(transform("moon", "crater"), "x")
    with pytest.raises(tf2_py.ConnectivityException):
        buffer.path("map", "crater")
    with pytest.raises(tf2_py.ExtrapolationException):
        buffer.path("map", "base", at(9))
    with pytest.raises(tf2_py.LookupException):
        buffer.path("map", "bse")


@pytest.mark.parametrize("what", ["parent", "children"])
def test_an_unknown_frame_is_named_and_similar_ones_are_suggested(tf2_py, buffer, what):
    with pytest.raises(tf2_py.LookupException) as raised:
        getattr(buffer, what)("bse")
    assert str(raised.value) == f'"bse" passed to {what} argument frame does not exist. Did you mean [base]?'
    with pytest.raises(tf2_py.InvalidArgumentException, match="cannot start with"):
        getattr(buffer, what)("/base")
    with pytest.raises(TypeError, match="frame: expected a str"):
        getattr(buffer, what)(1)
