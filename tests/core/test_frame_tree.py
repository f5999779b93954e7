"""The text that shows frames as trees."""

import pytest

from tf2_py import FrameInfo
from tf2_py._objects.listings import MAX_DEPTH, tree_text

pytestmark = pytest.mark.ours

ROOT = FrameInfo(None, False, 0, None, None)


def static(parent):
    return FrameInfo(parent, True, 1, None, None)


def names(text):
    """The lines without their facts."""
    return [line.partition(" (")[0] for line in text.splitlines()]


def test_a_parent_that_is_not_listed_itself_is_a_root():
    # As in the YAML of other buffers, which lists only children.
    assert names(tree_text({"odom": static("map")})) == ["map", "  odom"]


def test_a_frame_that_is_its_own_parent_is_a_loop():
    assert tree_text({"a": static("a")}).splitlines() == ["a (static) (loop)", "  a (static) (loop)"]


def test_a_long_chain_is_complete_and_not_indented_without_end():
    count = 10_000
    frames = {"f0": ROOT} | {f"f{i}": static(f"f{i - 1}") for i in range(1, count)}
    lines = tree_text(frames).splitlines()
    assert [line.split()[0] for line in lines] == list(frames)
    assert lines[MAX_DEPTH + 1] == "  " * MAX_DEPTH + f"f{MAX_DEPTH + 1} (static)"
