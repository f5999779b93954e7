# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What holds for every type that tf2_geometry_msgs and tf2_sensor_msgs transform."""

import copy
import textwrap
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from hypothesis import given, settings
from hypothesis import strategies as st
from leaks import assert_nothing_is_left
from numpy.testing import assert_allclose
from processes import output_of
from random_messages import Maker, numbers, transforms
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header
from textbook_transforms import numbers_in, turn, xyz
from times_and_transforms import stamp_ns, transform
from type_tables import ALL, STAMPED, UNSTAMPED

from tf2_ros.buffer_interface import TransformRegistration

every_type = pytest.mark.parametrize("cls", ALL, ids=lambda cls: cls.__name__)


@pytest.fixture
def t():
    return transform("map", "base", 7.25, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))


def apply(message, t):
    return TransformRegistration().get(type(message))(message, t)


def texts(m):
    """Every text outside a message's headers."""
    values = [getattr(m, name) for name in m.get_fields_and_field_types()]
    return [value for value in values if isinstance(value, str)]


@every_type
@settings(max_examples=40)
@given(transforms, st.integers(0, 1000))
def test_numbers_become_what_they_are_in_the_new_frame_and_texts_stay(cls, t, seed):
    message = Maker(seed).message(cls)
    got = apply(message, t)
    assert type(got) is cls and texts(got) == texts(message)
    if cls in STAMPED:
        assert (got.header.frame_id, stamp_ns(got)) == ("map", 7_250_000_000)
    wanted = numbers_in(message, turn(t.transform.rotation), xyz(t.transform.translation))
    # Rounding grows with the numbers that go in: translations reach 1e6.
    assert_allclose(numbers(got), wanted, rtol=1e-9, atol=1e-6)
    if cls in UNSTAMPED:
        assert apply(message, t.transform) == got


@every_type
def test_what_is_given_is_not_changed_and_the_result_shares_nothing_of_it(cls, t):
    def parts(m):
        if isinstance(m, list | np.ndarray) or hasattr(m, "get_fields_and_field_types"):
            yield id(m)
        inner = m if isinstance(m, list) else [getattr(m, f[1:]) for f in getattr(m, "__slots__", [])[:-1]]
        for part in inner:
            yield from parts(part)

    message = Maker(7).message(cls)
    before = copy.deepcopy((message, t))
    first, second = apply(message, t), apply(message, t)
    assert first == second
    assert (message, t) == before
    every = [*parts(message), *parts(t), *parts(first), *parts(second)]
    assert len(set(every)) == len(every)


@every_type
def test_other_objects_with_the_same_fields_are_transformed_alike(cls, t):
    message = Maker(10).message(cls)
    fields = {name: getattr(message, name) for name in cls.get_fields_and_field_types()}
    wanted = apply(message, t)
    assert apply(cls(**fields, check_fields=True), t) == wanted
    assert TransformRegistration().get(cls)(type("Derived", (cls,), {})(**fields), t) == wanted


@every_type
def test_the_result_goes_over_the_wire(cls, t):
    got = apply(Maker(9).message(cls), t)
    again = deserialize_message(serialize_message(got), cls)
    assert_allclose(numbers(again), numbers(got), rtol=1e-6)  # Point32 is float32 there
    assert repr(got).startswith(f"{cls.__module__.partition('.')[0]}.msg.{cls.__name__}(")


@every_type
def test_other_objects_and_transforms_are_type_errors_that_name_what_is_wanted(cls, t):
    function, message = TransformRegistration().get(cls), Maker(12).message(cls)
    # Points of every type share one function.
    wanted = (
        f"expected a (geometry|nav|sensor)_msgs/{cls.__name__.removesuffix('Stamped').removesuffix('32')}"
    )
    headless = [t.transform, SimpleNamespace(transform=t.transform)] * (cls in STAMPED)
    for arguments, text in (
        *[((wrong, t), wanted) for wrong in (None, 5, "text", [], ..., Header(), SimpleNamespace())],
        *[((message, wrong), "geometry_msgs/TransformStamped") for wrong in (None, 5, Pose(), Vector3())],
        *[((message, wrong), "a geometry_msgs/TransformStamped.*got") for wrong in headless],
    ):
        with pytest.raises(TypeError, match=text) as raised:
            function(*arguments)
        assert isinstance(raised.value, AttributeError)  # which programs of tf2 catch


@every_type
@pytest.mark.parametrize("q", [(np.nan, 0, 0, 1), (0, np.inf, 0, 1)], ids=str)
def test_a_transform_whose_rotation_is_not_finite_is_a_value_error(cls, q):
    with pytest.raises(ValueError, match="^transform.rotation: expected a quaternion of finite length, got "):
        apply(Maker(15).message(cls), transform("map", "base", 0, xyzw=q))


def every_part(message):
    """The message, its parts that are messages, and their parts."""
    if isinstance(message, list):
        parts = message
    else:
        yield message
        parts = [getattr(message, name) for name in message.get_fields_and_field_types()]
    for part in parts:
        if isinstance(part, list) or hasattr(part, "get_fields_and_field_types"):
            yield from every_part(part)


@every_type
@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf], ids=str)
def test_a_rotation_of_the_data_that_is_not_finite_is_a_value_error(cls, t, number):
    message = Maker(17).message(cls)
    which = r"poses\[\d\]: " if hasattr(message, "poses") else ""
    for quaternion in [part for part in every_part(message) if isinstance(part, Quaternion)]:
        for name in "xyzw":
            before = getattr(quaternion, name)
            setattr(quaternion, name, float(number))
            with pytest.raises(
                ValueError, match=f"^{which}(orientation|rotation|quaternion): expected finite numbers"
            ):
                apply(message, t)
            setattr(quaternion, name, before)


@every_type
def test_coordinates_that_are_not_finite_pass_through(cls, t):
    message = Maker(18).message(cls)
    points = [part for part in every_part(message) if isinstance(part, Point | Vector3)]
    for part in points:
        part.x = np.nan
    got = apply(message, t)
    assert bool(np.isnan(numbers(got)).any()) == bool(points)


@every_type
@pytest.mark.parametrize("q", [(0, 0, 0, 0), (1e-300, 0, 0, 0), (0, 0, 1e-8, 0)], ids=str)
def test_a_transform_without_a_rotation_only_moves(cls, t, q):
    message = Maker(15).message(cls)
    t.transform.rotation = Quaternion(**dict(zip("xyzw", map(float, q), strict=True)))
    straight = transform("map", "base", 7.25, (1, 2, 3))
    assert apply(message, t) == apply(message, straight)


@every_type
def test_a_frame_that_is_no_text_and_a_coordinate_that_is_no_number_are_type_errors(cls, t):
    t.header._frame_id = 5
    message = Maker(16).message(cls)
    if cls in STAMPED:
        with pytest.raises(TypeError, match="frame_id: expected a str, got int"):
            apply(message, t)
    t.transform.translation._x = "1"
    with pytest.raises(TypeError, match="must be real number"):
        apply(message, t)


def test_classes_that_look_otherwise_go_through_their_attributes():
    program = """
        import sys
        import geometry_msgs.msg, nav_msgs.msg, sensor_msgs.msg
        # A class derived from a message's has a __dict__, and a layout of its own.
        for package in (geometry_msgs.msg, nav_msgs.msg, sensor_msgs.msg):
            for name, cls in list(vars(package).items()):
                if isinstance(cls, type):
                    setattr(package, name, type(cls)(name, (cls,), {"__module__": cls.__module__}))
        sys.path.insert(0, "tests/support")
        from random_messages import Maker, numbers
        from type_tables import ALL
        from times_and_transforms import transform
        from tf2_ros.buffer_interface import TransformRegistration
        t = transform("map", "base", 7.25, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))
        for cls in ALL:
            got = TransformRegistration().get(cls)(Maker(19).message(cls), t)
            print(type(got) is cls, hasattr(got, "__dict__"), *map(float, numbers(got)))
    """
    found = output_of("-c", textwrap.dedent(program)).splitlines()
    t = transform("map", "base", 7.25, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))
    wanted = [numbers(apply(Maker(19).message(cls), t)) for cls in ALL]
    assert found == [" ".join(["True True", *map(str, map(float, n))]) for n in wanted]


@every_type
def test_calls_leave_nothing_behind(cls, t):
    message = Maker(18).message(cls)

    def call():
        apply(message, t)
        for wrong in (None, cls):
            with suppress(TypeError):
                TransformRegistration().get(cls)(wrong, t)

    assert_nothing_is_left(call, t.header.frame_id, message)
