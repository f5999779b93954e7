# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Message objects made and read by their slots, and what happens where that is not possible."""

import pytest
from geometry_msgs.msg import TransformStamped, Vector3
from processes import output_of
from rclpy.serialization import deserialize_message, serialize_message
from times_and_transforms import at, transform

from tf2_py._internal import assumptions


@pytest.fixture
def buffer(tf2_py):
    buffer = tf2_py.BufferCore()
    buffer.set_transform(transform("map", "odom", 1.5, (1, 2, 3), (0.5, 0.5, 0.5, 0.5)), "x")
    return buffer


@pytest.fixture
def layout():
    from tf2_py._tf2_py import Layout

    return Layout


def test_the_slots_of_this_ros_are_used(layout):
    assert layout(Vector3, ("x", "y", "z")).by_slot
    assert layout(TransformStamped, ("header", "child_frame_id", "transform")).by_slot


def test_messages_without_slots_are_reported(layout, monkeypatch):
    row = next(row for row in assumptions.ROWS if row.used == "the slots of messages")
    monkeypatch.setattr(row, "is_reported", False)
    layout(Vector3, ("x", "y", "z"))
    assert not row.is_reported
    layout(Vector3, ("x", "y"))
    assert row.is_reported


def test_an_answer_is_a_message_like_any_other(buffer):
    m, other = (buffer.lookup_transform_core("map", "odom", at(1.5)) for _ in range(2))
    other.header.stamp.sec, other.transform.translation.x = 9, 9.0  # nothing of it is shared
    assert type(m) is TransformStamped
    assert m == transform("map", "odom", 1.5, (1, 2, 3), (0.5, 0.5, 0.5, 0.5))
    assert repr(m) == repr(transform("map", "odom", 1.5, (1, 2, 3), (0.5, 0.5, 0.5, 0.5)))
    assert deserialize_message(serialize_message(m), TransformStamped) == m
    for part in (m, m.header, m.header.stamp, m.transform, m.transform.translation, m.transform.rotation):
        ordinary = type(part)()
        assert all(hasattr(part, slot) for slot in ordinary.__slots__)
        assert part._check_fields == ordinary._check_fields


def test_a_message_with_a_deleted_field_is_a_type_error(buffer):
    m = transform("map", "odom", 2)
    del m.transform.translation._x
    with pytest.raises(TypeError, match="_x"):
        buffer.set_transform(m, "x")


class Subclass(Vector3):
    """A message class of a program's own."""


def with_slots(names, **attributes):
    """A class of x, y, z, whose slots and attributes are these."""

    def make(self):
        for name in ("x", "y", "z"):
            setattr(self, name, 0.0)

    return type("Odd", (), {"__slots__": names, "__init__": make} | attributes)


def one_more(slot):
    """A property whose value is not that of its slot."""
    return property(lambda self: getattr(self, slot) + 1.0, lambda self, value: setattr(self, slot, value))


OTHER_CLASSES = {
    "a subclass": Subclass,
    "another slot": with_slots(("x", "y", "z", "extra")),
    "a __dict__": with_slots(("x", "y", "z", "__dict__")),
    "properties": with_slots(("_x", "_y", "_z"), x=one_more("_x"), y=one_more("_y"), z=one_more("_z")),
    "a __new__": with_slots(("x", "y", "z"), __new__=lambda cls: object.__new__(cls)),
}


@pytest.mark.parametrize("cls", OTHER_CLASSES.values(), ids=OTHER_CLASSES)
def test_classes_that_look_otherwise_go_through_their_attributes(layout, cls):
    assert not layout(cls, ("x", "y", "z")).by_slot
    assert layout(with_slots(("x", "y", "z")), ("x", "y", "z")).by_slot


def test_subclasses_of_the_message_classes_are_read(buffer):
    m = transform("map", "odom", 2)
    m.transform.translation = Subclass(x=7.0)
    buffer.set_transform(m, "x")
    assert buffer.lookup_transform_core("map", "odom", at(2)).transform.translation.x == 7.0


def test_importing_the_engine_imports_no_message_package():
    code = "import sys, tf2_py; print(*(m for m in ('rclpy', 'geometry_msgs', 'numpy') if m in sys.modules))"
    assert output_of("-c", code) == "\n"
