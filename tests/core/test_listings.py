# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a buffer lists of its frames: texts, facts and its repr; answers: test_buffer_beside_model.py."""

import copy
import pickle
import random
import re

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st
from times_and_transforms import S, at, at_ns, transform


@pytest.fixture
def buffer(tf2_py):
    return tf2_py.BufferCore()


def test_frames_without_data_give_an_empty_list_never_an_empty_document(buffer):
    buffer.set_transform(transform("map", "odom", 1), "x")
    buffer.clear()
    assert buffer.all_frames_as_yaml() == "[]"
    assert buffer.all_frames_as_string() == "Frame odom exists with parent NO_PARENT.\n"


names = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), min_size=1)


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


@pytest.mark.parametrize("name", ["a", "/a", "//a", "a/", "/a/b", "///", "/"])
def test_the_stored_name_is_the_one_that_an_inserted_frame_has(tf2_py, buffer, name):
    buffer.set_transform(transform("map", name, 1), "x")
    assert {*buffer.frames()} == ({"map", tf2_py.stored_name(name)} if name != "/" else set())


@pytest.mark.parametrize("name", [None, b"a", 1], ids=repr)
def test_what_is_no_name_has_no_stored_name(tf2_py, name):
    with pytest.raises(TypeError):
        tf2_py.stored_name(name)


def test_the_graph_has_an_edge_from_parent_to_child(buffer):
    buffer.set_transform(transform("map", "odom", 1), "x")
    buffer.set_transform(transform('a"b', "c\\d", 1), 'e"f')
    for dot in (buffer._allFramesAsDot(), buffer._allFramesAsDot(at(3.5))):
        assert '"map" -> "odom"' in dot and '"a\\"b" -> "c\\\\d"' in dot
        assert dot.startswith("digraph G {")
        assert dot.rstrip().endswith("}")
    assert "2.500 sec old" in dot


def test_a_parent_that_is_not_listed_itself_is_a_root(tf2_py):
    # As in the YAML of other buffers, which lists only children.
    from tf2_py._objects.listings import tree_text

    assert tree_text({"odom": tf2_py.FrameInfo("map", True, 1, None, None)}) == "map\n  odom (static)"


def test_the_tree_of_a_long_chain_is_complete_and_not_indented_without_end(buffer):
    names = [f"f{i}" for i in range(10_000)]
    links = [transform(parent, child) for parent, child in zip(names, names[1:], strict=False)]
    buffer.set_transforms(links, "x", static=True)
    lines = buffer.tree().splitlines()
    assert [line.split()[0] for line in lines] == names
    assert max(len(line) for line in lines) < 200


@pytest.fixture
def wide(buffer):
    """Many frames, of three parents, in no alphabetical order."""
    order = random.Random(1).sample(range(9000), 9000)
    buffer.set_transforms([transform(f"p{i % 3}", f"f{i:04}", 1 + i) for i in order], "x")
    return buffer, order


def test_listings_of_many_frames_are_complete_and_in_order(wide):
    buffer, order = wide
    names = [f"f{i:04}" for i in order]
    assert list(buffer.histories()) == names
    assert re.findall(r"^f\d+", buffer.all_frames_as_yaml(), re.M) == names
    assert re.findall(r"Frame (f\d+) ", buffer.all_frames_as_string()) == names
    assert re.findall(r"-> (?:\")?(f\d+)", buffer._allFramesAsDot()) == names
    assert [name for name in buffer.frames() if name.startswith("f")] == names
    assert buffer.children("p1") == [name for name, i in zip(names, order, strict=True) if i % 3 == 1]
    tree = [line.split(" (")[0] for line in buffer.tree().splitlines()]
    assert tree == [
        line for p in range(3) for line in (f"p{p}", *[f"  f{i:04}" for i in range(9000) if i % 3 == p])
    ]
    assert "9003 frames, 9000 samples over 8999.0 s" in repr(buffer)


@pytest.fixture
def robot(buffer):
    """map -> odom, dynamic; odom -> camera, static."""
    for ns in (10 * S, 10 * S + 7, 12 * S + 1):
        buffer.set_transform(transform("map", "odom", ns=ns), "x")
    buffer.set_transform_static(transform("odom", "camera", 99), "x")
    return buffer


class Name(str):
    """Of a program's own."""


class TestAtAPrompt:
    def test_the_facts_of_a_frame_can_be_pickled_and_copied(self, robot):
        frames = robot.frames()
        assert pickle.loads(pickle.dumps(frames)) == copy.deepcopy(frames) == frames

    def test_only_the_names_of_frames_are_in_a_buffer(self, robot):
        assert all(name in robot for name in ("map", Name("map"), "camera"))
        for other in (None, 5, b"map", ["map"], ("map",), "a\0b", "\ud800"):
            assert other not in robot

    def test_a_buffer_is_true_and_no_container_otherwise(self, buffer):
        assert buffer  # also without frames: programs test whether they have a buffer
        for function in (len, iter, list, reversed):
            with pytest.raises(TypeError):
                function(buffer)

    def test_its_repr_tells_what_it_holds_and_names_its_class(self, robot, tf2_ros):
        class Own(tf2_ros.Buffer):
            frames = tree = None  # a subclass may use the names itself

        waits = [robot._wait("map", "nowhere", at_ns(0)) for _ in range(2)]
        assert repr(robot) == "<tf2_py.BufferCore: 3 frames, 4 samples over 2.0 s, 2 waiters>"
        assert all(wait.cancel() for wait in waits)
        robot.clear()
        assert repr(robot) == "<tf2_py.BufferCore: 3 frames, 1 sample, 0 waiters>"
        assert repr(Own()) == f"<{__name__}.{Own.__qualname__}: 0 frames, 0 samples, 0 waiters>"
        for buffer in (tf2_ros.Buffer(), tf2_ros.Buffer.__new__(tf2_ros.Buffer)):  # also uninitialized
            assert repr(buffer) == "<tf2_ros.Buffer: 0 frames, 0 samples, 0 waiters>"
