"""The texts that list what a buffer knows."""

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st
from making import at, transform


@pytest.fixture
def buffer(tf2_py):
    return tf2_py.BufferCore()


@pytest.mark.ours
def test_frames_without_data_give_an_empty_list_never_an_empty_document(buffer):
    buffer.set_transform(transform("map", "odom", 1), "x")
    buffer.clear()
    assert buffer.all_frames_as_yaml() == "[]"
    assert buffer.all_frames_as_string() == "Frame odom exists with parent NO_PARENT.\n"


names = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), min_size=1)


@pytest.mark.ours
@given(names.filter(lambda name: name[0] != "/" and name != "NO_PARENT"))
@example("no")
@example("1")
@example("- a: b")
@example("a #b'\"\\")
@example("\ufeffa\x7f\x85\u2028\u202e\u200d")
@example('\x1b[31m"\\')
@example("long '" * 500)
def test_every_name_survives_yaml_and_is_answered_as_it_is(tf2_py, name):
    buffer, child, other = tf2_py.BufferCore(), name + "1", name + "2"
    buffer.set_transform(transform(name, child, 1), name)
    buffer.set_transform(transform(child, other, 1), "x")
    listed = yaml.safe_load(buffer.all_frames_as_yaml())
    assert (listed[child]["parent"], listed[child]["broadcaster"]) == (name, name)
    assert list(listed) == [child, other]
    assert buffer._getFrameStrings() == [child, name, other]
    m = buffer.lookup_transform_core(name, other, at(1))
    assert (m.header.frame_id, m.child_frame_id) == (name, other)


def test_the_graph_has_an_edge_from_parent_to_child(buffer):
    buffer.set_transform(transform("map", "odom", 1), "x")
    for dot in (buffer._allFramesAsDot(), buffer._allFramesAsDot(at(3.5))):
        assert '"map" -> "odom"' in dot
        assert dot.startswith("digraph G {")
        assert dot.rstrip().endswith("}")
    assert "2.500 sec old" in dot


@pytest.mark.ours
def test_quotes_in_names_do_not_break_the_graph(buffer):
    buffer.set_transform(transform('a"b', "c\\d", 1), 'e"f')
    assert '"a\\"b" -> "c\\\\d"' in buffer._allFramesAsDot()


@pytest.mark.ours
def test_what_does_not_print_is_escaped_in_the_sentences_and_the_graph(buffer):
    buffer.set_transform(transform("a\nb", "\x1b[31mred", 1), "me\u202e")
    assert buffer.all_frames_as_string() == "Frame \\x1b[31mred exists with parent a\\nb.\n"
    dot = buffer._allFramesAsDot()
    # Graphviz drops a single backslash.
    assert '"a\\\\nb" -> "\\\\x1b[31mred"' in dot
    assert "Broadcaster: me\\\\u202e\\n" in dot
    assert all(line.isprintable() for line in dot.splitlines())


@pytest.mark.ours
def test_listings_of_more_frames_than_one_slice_are_complete(buffer):
    # Also in their bytes: names of 200 fill a slice before it has all the frames that it may have.
    names = [f"{i:05d}{'x' * (i % 200)}" for i in range(5000)]
    buffer.set_transforms([transform("map", name, 1) for name in names], "me")
    buffer.set_transform(transform("map", "y" * 300_000, 1), "you")
    names.append("y" * 300_000)
    assert buffer._getFrameStrings() == [names[0], "map", *names[1:]]
    listed = buffer.all_frames_as_string().splitlines()
    assert listed == [f"Frame {name} exists with parent map." for name in names]
    assert buffer._allFramesAsDot().count("Broadcaster: me") == 5000
