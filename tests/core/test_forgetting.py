"""Frames that a program forgets."""

import copy
import pickle
import random

import pytest
from making import S, at, transform, translation

pytestmark = pytest.mark.ours


@pytest.fixture
def buffer(tf2_py):
    buffer = tf2_py.BufferCore()
    for second in (1, 2):
        buffer.set_transform(transform("map", "base", second), "x")
        buffer.set_transform(transform("base", "arm", second), "x")
    buffer.set_transform_static(transform("arm", "camera"), "x")
    return buffer


def insert(buffer, parent, child, seconds=3.0, x=0.0):
    buffer.set_transform(transform(parent, child, seconds, (x, 0, 0)), "y")


def test_a_frame_without_children_is_as_if_it_had_never_been_there(tf2_py, buffer):
    samples = buffer.statistics()["samples"]
    assert buffer.forget("camera") is True
    assert "camera" not in buffer
    assert "camera" not in buffer.tree()
    assert list(buffer.frames()) == buffer._getFrameStrings() == ["base", "map", "arm"]
    assert buffer.statistics()["frames"] == 3
    assert buffer.statistics()["samples"] == samples - 1
    with pytest.raises(
        tf2_py.LookupException, match='"camera" passed to lookupTransform argument source_frame'
    ):
        buffer.lookup_transform_core("arm", "camera", at(0))
    with pytest.raises(
        tf2_py.LookupException, match='"camera" passed to forget argument frame does not exist'
    ):
        buffer.forget("camera")
    buffer._self_check()


@pytest.mark.parametrize("way", [copy.copy, lambda buffer: pickle.loads(pickle.dumps(buffer))])
def test_copies_have_forgotten_it_too(buffer, way):
    buffer.forget("camera")
    other = way(buffer)
    assert other.tree() == buffer.tree()
    assert other._getFrameStrings() == buffer._getFrameStrings()
    insert(other, "arm", "camera")
    assert "camera" in other
    assert "camera" not in buffer
    other._self_check()


def test_waits_are_told(buffer):
    answers = []
    gone = buffer._wait("map", "base", at(3), notify=answers.append)
    back = buffer._wait("arm", "hand", at(3), notify=answers.append)
    insert(buffer, "arm", "hand", 1)
    buffer.forget("hand")
    buffer.forget("base")
    insert(buffer, "map", "base", 3)
    insert(buffer, "arm", "hand", 3)
    assert [one.child_frame_id for one in answers] == ["base", "hand"]
    assert gone.answer is not None
    assert back.answer is not None


def test_random_steps_agree_with_a_buffer_that_never_had_it(tf2_py):
    """Answers are those of a buffer that got only the others, and what came later."""
    numbers, names = random.Random(5), list("abcdef")
    for _ in range(60):
        buffer, steps = tf2_py.BufferCore(100.0), []
        for step in range(80):
            if numbers.random() < 0.1:
                name = numbers.choice(names)
                if name in buffer:
                    buffer.forget(name)
                steps = [one for one in steps if one[1] != name]
            else:
                # A later name is given in an earlier one, so that no loop is closed.
                parent, child = sorted(numbers.sample(names, 2))
                steps.append((parent, child, 1 + step / 10, numbers.randrange(5)))
                insert(buffer, *steps[-1])
            buffer._self_check()
        plain = tf2_py.BufferCore(100.0)
        for one in steps:
            insert(plain, *one)
        assert buffer.frames() == plain.frames()
        for target in names:
            for source in names:
                for second in (0, 2.05, 5.5, 8.9):
                    assert outcome(buffer, target, source, second) == outcome(plain, target, source, second)


def outcome(buffer, target, source, second):
    try:
        found = buffer.lookup_transform_core(target, source, at(second))
    except Exception as error:  # the class is compared
        return type(error)
    return (found.header.stamp.sec * S + found.header.stamp.nanosec, translation(found))
