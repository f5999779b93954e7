# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Answers that the program has dropped are filled again; what it holds never changes."""

import copy
import gc
import json
import operator
import sysconfig

import pytest
from leaks import assert_nothing_is_left
from messages_with_or_without_ros import TransformStamped
from paths import PROGRAMS
from processes import output_of
from random_runs import times
from times_and_transforms import at, rotation, stamp_ns, transform, translation

KEPT = 8
with_gil = pytest.mark.skipif(
    bool(sysconfig.get_config_var("Py_GIL_DISABLED")), reason="without the GIL, every message is a new one"
)
LOOKUPS = times(20_000, 100_000)
PARTS = ["header", "header.stamp", "transform", "transform.translation", "transform.rotation"]


@pytest.fixture
def look_up(tf2_py):
    buffer = tf2_py.BufferCore()
    buffer.set_transforms([transform("map", "robot", t, (t, 2, 3), (0.5,) * 4) for t in (1, 9)], "x")

    def look_up(seconds=5.0):
        return buffer.lookup_transform_core("map", "robot", at(seconds))

    # New ones for those that other tests have left, which gc.freeze() may have hidden.
    _ = [look_up() for _ in range(2 * KEPT)]
    return look_up


def is_right(message, seconds=5.0):
    expected = transform("map", "robot", seconds, (seconds, 2, 3), (0.5,) * 4)
    return type(message) is TransformStamped and message == expected and whole(message)


def whole(message):
    """Whether all slots are set, as the constructor sets them, by which ROS's own conversion reads them."""
    parts = [message, *(operator.attrgetter(name)(message) for name in PARTS)]
    ordinary = TransformStamped()
    made = [ordinary, *(operator.attrgetter(name)(ordinary) for name in PARTS)]
    return all(
        type(one) is type(other)
        and all(type(getattr(one, slot)) is type(getattr(other, slot)) for slot in type(one).__slots__)
        and getattr(one, "_check_fields", None) == getattr(other, "_check_fields", None)
        for one, other in zip(parts, made, strict=True)
    )


def known():
    """The addresses of the messages that exist."""
    return {id(one) for one in gc.get_objects() if type(one) is TransformStamped}


def fill(look_up, alter=lambda _: None):
    """Look up as often as messages are kept, drop the answers, and alter each before."""
    for _ in range(KEPT):
        alter(look_up())


@with_gil
def test_a_dropped_message_is_used_again(look_up):
    fill(look_up)
    for seconds in (2.0, 3.25, 8.5):
        before = known()
        answer = look_up(seconds)
        assert id(answer) in before and is_right(answer, seconds)
        del answer


def test_a_held_message_is_not(look_up):
    fill(look_up)
    held = [look_up(seconds) for seconds in range(2, 9)] * 2
    answers = [look_up(1.0) for _ in range(3 * KEPT)]
    assert len({id(one) for one in (*held, *answers)}) == 7 + 3 * KEPT
    assert all(is_right(one, seconds) for one, seconds in zip(held, [*range(2, 9)] * 2, strict=True))
    assert all(is_right(one, 1.0) for one in answers)


@pytest.mark.parametrize("name", PARTS)
def test_a_message_with_a_held_part_is_not(look_up, name):
    fill(look_up)
    get = operator.attrgetter(name)
    held = [get(look_up(2.0)) for _ in range(KEPT)]
    before = repr(held)
    for _ in range(2 * KEPT):
        assert all(get(look_up(3.0)) is not one for one in held)
    assert repr(held) == before == repr([get(look_up(2.0))] * KEPT)


def test_a_held_number_or_name_does_not_change(look_up):
    fill(look_up)
    held = [look_up(2.25).transform.translation.x for _ in range(KEPT)]
    held += [look_up(2.25).header.stamp.nanosec for _ in range(KEPT)]
    fill(lambda: look_up(3.5))
    assert held == [2.25] * KEPT + [250_000_000] * KEPT


class Other(TransformStamped):
    """A class whose messages have the same slots."""

    __slots__ = ()


class Name(str):
    """A name that is more than a str."""


def slot_of(thing, name):
    return f"_{name}" if f"_{name}" in type(thing).__slots__ else name


def set_slot(part, field, value):
    def alter(message):
        thing = operator.attrgetter(part)(message) if part else message
        setattr(thing, slot_of(thing, field), value(message) if callable(value) else value)

    return alter


def delete(part, field):
    def alter(message):
        thing = operator.attrgetter(part)(message) if part else message
        delattr(thing, slot_of(thing, field))

    return alter


def become_other(message):
    message.__class__ = Other


ALTERED = {
    "the class": become_other,
    "a number": set_slot("transform.translation", "x", 99.0),
    "all of a part": set_slot("transform", "rotation", lambda m: copy.deepcopy(m.transform.rotation)),
    "an int as a float": set_slot("transform.translation", "y", 1),
    "a bool as an int": set_slot("header.stamp", "sec", True),
    "a large int": set_slot("header.stamp", "sec", 10**30),
    "a name": set_slot("header", "frame_id", "mine"),
    "a name of another class": set_slot("", "child_frame_id", Name("mine")),
    "something else as a part": set_slot("", "header", [1, 2]),
    "a part of another class": set_slot("transform", "rotation", lambda m: m.transform.translation),
    "a part of another message": set_slot("", "transform", TransformStamped().transform),
    "a deleted number": delete("transform.rotation", "w"),
    "a deleted name": delete("header", "frame_id"),
    "a deleted part": delete("", "header"),
}


@pytest.mark.parametrize("alter", ALTERED.values(), ids=ALTERED)
def test_nothing_remains_of_what_the_program_altered(look_up, alter):
    fill(look_up, alter)
    answers = [look_up() for _ in range(2 * KEPT)]
    assert all(map(is_right, answers))
    fill(look_up, alter)
    for _ in range(2 * KEPT):
        assert is_right(look_up())


@pytest.mark.skipif("_check_fields" not in TransformStamped.__slots__, reason="these messages check nothing")
def test_nothing_remains_of_a_message_that_checks_its_fields(look_up):
    fill(look_up, lambda message: setattr(message, "_check_fields", "mine"))
    for _ in range(2 * KEPT):
        assert is_right(look_up())


def test_what_is_put_into_an_answer_is_freed_with_later_answers(look_up):
    ended = []

    class Ends:
        def __del__(self):
            ended.append(look_up(2.0))  # while the lookup that drops it has an answer

    fill(look_up, lambda message: set_slot("", "header", Ends())(message))
    held = [look_up(3.0) for _ in range(3 * KEPT)]
    assert len(ended) == KEPT
    assert all(is_right(one, 3.0) for one in held) and all(is_right(one, 2.0) for one in ended)


def test_a_finalizer_of_the_class_runs_for_each_message(look_up, monkeypatch):
    fill(look_up)
    ended = []
    monkeypatch.setattr(TransformStamped, "__del__", lambda self: ended.append(stamp_ns(self)), raising=False)
    for seconds in range(1, 9):
        look_up(float(seconds))
        look_up(float(seconds))
    fill(look_up)
    # The messages from before have none until they are replaced; the last ones are still kept.
    assert set(ended) >= {seconds * 10**9 for seconds in range(1, 9)}
    monkeypatch.undo()
    fill(look_up)
    assert is_right(look_up())


def test_an_answer_of_another_shape_is_right(look_up, tf2_py):
    other = tf2_py.BufferCore()
    other.set_transform_static(transform("a", "b", xyz=(7, 8, 9), xyzw=(0, 0, 1, 0)), "x")
    for _ in range(2 * KEPT):
        assert is_right(look_up(4.0), 4.0)
        answer = other.lookup_transform_core("a", "b", at(0))
        assert (translation(answer), rotation(answer), stamp_ns(answer)) == ((7, 8, 9), (0, 0, 1, 0), 0)


def test_dropping_and_holding_leave_nothing_behind(look_up):
    held = []

    def some():
        for i in range(20):
            answer = look_up()
            if i % 3 == 0:
                held.append(answer.transform.translation if i % 2 else answer)
        held.clear()

    assert_nothing_is_left(some, None, "map", "robot", 0.5, times=500)


@pytest.mark.repeated
def test_whatever_is_kept_while_threads_signals_and_finalizers_look_up_stays_as_it_is():
    """By hand for minutes: ``cd tests/support; PYTHONPATH=. python programs/keeps_answers.py 10000000``."""
    found = json.loads(output_of(PROGRAMS / "keeps_answers.py", LOOKUPS))
    assert found["lookups"] >= LOOKUPS and found["kept"] > LOOKUPS // 4
    assert (found["changed"], found["wrong"]) == ([], [])
    assert found["left"] <= KEPT


FIRST_USE = """
import threading
from times_and_transforms import at, transform
from tf2_py import BufferCore

def use(child):
    for second in range(300):
        buffer.set_transform(transform("map", child, second), "x")
        buffer.lookup_transform_core("map", child, at(0))

buffer = BufferCore()
threads = [threading.Thread(target=use, args=(f"c{number}",)) for number in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print("done")
"""


@pytest.mark.parametrize("attempt", range(4))
def test_the_first_messages_of_a_process_may_come_from_several_threads(attempt):
    assert output_of("-c", FIRST_USE) == "done\n"


AT_EXIT = """
import atexit, gc
from times_and_transforms import at, transform
from messages_with_or_without_ros import TransformStamped

def count():  # runs last, because it was registered first
    print(sum(type(one) is TransformStamped for one in gc.get_objects()))
    for _ in range(9):
        buffer.lookup_transform_core("a", "b", at(0))
    print(sum(type(one) is TransformStamped for one in gc.get_objects()))

atexit.register(count)
import tf2_py
buffer = tf2_py.BufferCore()
buffer.set_transform_static(transform("a", "b"), "x")
for _ in range(20):
    buffer.lookup_transform_core("a", "b", at(0))
print(sum(type(one) is TransformStamped for one in gc.get_objects()))
"""


@with_gil
def test_nothing_is_kept_when_the_interpreter_ends():
    assert output_of("-c", AT_EXIT).split() == [str(KEPT), "0", "0"]
