"""The texts that list what a buffer knows."""

import pytest
import yaml
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


@pytest.mark.ours
@pytest.mark.parametrize(
    "name",
    [
        "no",
        "1",
        "a: b",
        "a'b",
        'a"b',
        "a #b",
        "- a",
        "tab\there",
        "line\nbreak",
        "\x1b",
        "λ",
        "a\\b",
        "😀",
        " a",
        "a\u202eb\u200d",
        "\ufeffa\x7f\x85\u2028",
        '\x1b[31m"\\',
        "long" * 500,
        "long '" * 500,
        "机器人",
        "fäßchen",
    ],
)
def test_every_name_survives_yaml(buffer, name):
    buffer.set_transform(transform(name, "child", 1), name)
    buffer.set_transform(transform("child", name + "2", 1), "x")
    listed = yaml.safe_load(buffer.all_frames_as_yaml())
    assert listed["child"]["parent"] == name
    assert listed["child"]["broadcaster"] == name
    assert list(listed) == ["child", name + "2"]


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
def test_a_program_gets_the_names_as_they_are(buffer):
    names = ["\x1b[31mred", "a\nb"]
    buffer.set_transform(transform(*reversed(names), 1), "x")
    assert buffer._getFrameStrings() == names
    assert buffer._chain(names[1], at(1), names[0], at(1), names[1]) == names
    m = buffer.lookup_transform_core(*names, at(1))
    assert [m.header.frame_id, m.child_frame_id] == names


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


def test_an_authority_may_be_empty(buffer):
    buffer.set_transform(transform("map", "odom", 1), "")
    assert yaml.safe_load(buffer.all_frames_as_yaml())["odom"]["broadcaster"] == ""


@pytest.mark.ours
def test_a_chain_follows_each_half_at_its_own_time(buffer):
    for parent, child, first, last in (
        ("c", "a", 1, 2),
        ("d", "c", 4, 6),
        ("a", "d", 4, 6),
        ("d", "b", 4, 6),
    ):
        for second in (first, last):
            buffer.set_transform(transform(parent, child, second), "x")
    # At 5 s c hangs from d, and d from a; at 1 s a hangs from c.
    assert buffer._chain("b", at(5), "a", at(1), "c") == ["a", "c", "d", "b"]
