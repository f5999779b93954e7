"""What a buffer tells at a prompt: its frames, what is in it, and its repr."""

import copy
import pickle

import pytest
from forking import in_a_child
from making import S, at_ns, transform

pytestmark = pytest.mark.ours


@pytest.fixture
def buffer(tf2_py):
    return tf2_py.BufferCore()


@pytest.fixture
def robot(buffer):
    """map -> odom -> base, dynamic, with different histories; base -> camera, static."""
    for ns in (10 * S, 10 * S + 7, 12 * S + 1):
        buffer.set_transform(transform("map", "odom", ns=ns), "x")
    for ns in (11 * S - 3, 11 * S):
        buffer.set_transform(transform("odom", "base", ns=ns), "x")
    buffer.set_transform_static(transform("base", "camera", 99), "x")
    return buffer


def test_the_facts_of_a_frame_can_be_pickled_and_copied(tf2_py, robot):
    frames = robot.frames()
    assert pickle.loads(pickle.dumps(frames)) == copy.deepcopy(frames) == frames


class Name(str):
    """Of a program's own."""


@pytest.mark.parametrize("name", ["map", Name("map"), "odom", "base", "camera"])
def test_the_name_of_a_frame_is_in_a_buffer(robot, name):
    assert name in robot


@pytest.mark.parametrize("other", [None, 5, b"map", ["map"], ("map",), "a\0b", "\ud800"], ids=ascii)
def test_what_cannot_be_the_name_of_a_frame_is_not_in_a_buffer(robot, other):
    assert other not in robot


def test_a_buffer_is_true_and_no_container_otherwise(tf2_py, buffer):
    assert buffer  # also without frames: programs test whether they have a buffer
    for function in (len, iter, list, reversed):
        with pytest.raises(TypeError):
            function(buffer)


def test_a_subclass_may_use_the_names_itself(tf2_ros):
    class Own(tf2_ros.Buffer):
        def __init__(self):
            super().__init__()
            self.frames = ["mine"]
            self.tree = None

    own = Own()
    own.set_transform(transform("map", "odom", 1), "x")
    assert own.frames == ["mine"]
    assert "2 frames" in repr(own)


def test_the_repr_tells_what_a_buffer_holds_also_in_a_forked_child(tf2_py, robot):
    waits = [robot._wait("map", "nowhere", at_ns(0)) for _ in range(2)]
    assert repr(robot) == "<tf2_py.BufferCore: 4 frames, 6 samples over 2.0 s, 2 waiters>"

    def look():
        assert repr(robot) == "<tf2_py.BufferCore: 4 frames, 6 samples over 2.0 s, 0 waiters>"
        assert "map" in robot and len(robot.frames()) == 4 and "camera (static)" in robot.tree()

    assert in_a_child(look) == 0
    assert all(wait.cancel() for wait in waits)
    robot.clear()
    assert repr(robot) == "<tf2_py.BufferCore: 4 frames, 1 sample, 0 waiters>"


def test_the_repr_shows_the_name_of_a_class_also_before_it_is_initialised(tf2_ros):
    class Own(tf2_ros.Buffer):
        pass

    empty = ": 0 frames, 0 samples, 0 waiters>"
    for buffer in (tf2_ros.Buffer(), tf2_ros.Buffer.__new__(tf2_ros.Buffer)):
        assert repr(buffer) == f"<tf2_ros.Buffer{empty}"
    assert repr(Own()) == f"<{__name__}.{Own.__qualname__}{empty}"
