"""The text that shows frames as trees."""

import pytest
from making import S, transform

from tf2_py import FrameInfo
from tf2_py._objects.listings import MAX_DEPTH, tree_text

pytestmark = pytest.mark.ours

ROOT = FrameInfo(None, False, 0, None, None)


def static(parent):
    return FrameInfo(parent, True, 1, None, None)


def dynamic(parent, *stamps_ns):
    return FrameInfo(parent, False, len(stamps_ns), min(stamps_ns), max(stamps_ns))


def names(text):
    """The lines without their facts."""
    return [line.partition(" (")[0] for line in text.splitlines()]


def test_a_line_has_the_facts_of_a_frame():
    frames = {
        "odom": dynamic("map", 10 * S, 11 * S, 12 * S + 5),
        "map": ROOT,
        "base": dynamic("odom", 7),
        "camera": static("base"),
    }
    assert tree_text(frames).splitlines() == [
        "map",
        "  odom (3 samples over 2.000 s, newest at 12.000000005)",
        "    base (1 sample, at 0.000000007)",
        "      camera (static)",
    ]


def test_a_parent_that_is_not_listed_itself_is_a_root():
    # As in the YAML of other buffers, which lists only children.
    assert names(tree_text({"odom": static("map")})) == ["map", "  odom"]


def test_a_loop_is_shown_once_after_the_trees_and_marked():
    frames = {"c": static("b"), "a": static("c"), "b": static("a"), "tail": static("b"), "zz": ROOT}
    assert tree_text(frames).splitlines() == [
        "zz",
        "a (static) (loop)",
        "  b (static)",
        "    c (static)",
        "      a (static) (loop)",
        "    tail (static)",
    ]


def test_two_loops_are_two_texts():
    frames = {"a": static("b"), "b": static("a"), "x": static("y"), "y": static("x"), "aa": static("y")}
    shown = names(tree_text(frames))
    assert shown == ["a", "  b", "    a", "x", "  y", "    aa", "    x"]


def test_a_frame_that_is_its_own_parent_is_a_loop():
    assert tree_text({"a": static("a")}).splitlines() == ["a (static) (loop)", "  a (static) (loop)"]


def test_a_long_chain_is_complete_and_not_indented_without_end():
    count = 10_000
    frames = {"f0": ROOT} | {f"f{i}": static(f"f{i - 1}") for i in range(1, count)}
    lines = tree_text(frames).splitlines()
    assert [line.split()[0] for line in lines] == list(frames)
    assert lines[MAX_DEPTH + 1] == "  " * MAX_DEPTH + f"f{MAX_DEPTH + 1} (static)"


def test_what_does_not_print_is_escaped():
    assert names(tree_text({"\x1b[31mred\n": static("a\u202e")})) == ["a\\u202e", "  \\x1b[31mred\\n"]


def test_a_buffer_shows_its_tree(tf2_py):
    buffer = tf2_py.BufferCore()
    assert buffer.tree() == "no frames"
    buffer.set_transform(transform("map", "odom", 1), "x")
    buffer.set_transform_static(transform("odom", "base"), "x")
    assert buffer.tree() == "map\n  odom (1 sample, at 1.000000000)\n    base (static)"
    assert buffer.tree() == tree_text(buffer.frames())
