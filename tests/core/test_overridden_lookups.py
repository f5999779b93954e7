# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The lookups without options call the methods of BufferCore by name: these can be overridden and patched."""

from unittest import mock

import pytest
from geometry_msgs.msg import PointStamped
from times_and_transforms import at, transform

# What a method calls, what that may return, and what the method then returns.
CASES = {
    "lookup_transform": ("lookup_transform_core", "an answer", "an answer"),
    "can_transform": ("can_transform_core", [1, "a reason"], True),
    "lookup_transform_full": ("lookup_transform_full_core", "an answer", "an answer"),
    "can_transform_full": ("can_transform_full_core", [1, "a reason"], True),
}


@pytest.fixture(params=CASES)
def case(request):
    return request.param, *CASES[request.param]


@pytest.fixture
def asked(case):
    return ("map", at(1), "robot", at(1), "odom") if "full" in case[0] else ("map", "robot", at(1))


def test_by_a_subclass(tf2_ros, case, asked):
    name, core, returned, wanted = case
    calls = []

    def override(self, *arguments):
        calls.append((self, arguments))
        return returned

    buffer = type("Mine", (tf2_ros.Buffer,), {core: override})()
    assert getattr(buffer, name)(*asked) == wanted
    assert calls == [(buffer, asked)]


@pytest.mark.parametrize("of_class", [False, True])
def test_by_mock(tf2_ros, case, asked, of_class):
    name, core, returned, wanted = case
    buffer = tf2_ros.Buffer()
    with mock.patch.object(tf2_ros.Buffer if of_class else buffer, core, return_value=returned) as patched:
        assert getattr(buffer, name)(*asked) == wanted
    patched.assert_called_once_with(*asked)


def test_a_patch_with_autospec_gets_the_buffer(tf2_ros, case, asked):
    buffer = tf2_ros.Buffer()
    with mock.patch.object(tf2_ros.Buffer, case[0], autospec=True) as patched:
        getattr(buffer, case[0])(*asked)
    patched.assert_called_once_with(buffer, *asked)


@pytest.mark.parametrize("further", [{"timeout": 1.0}, {"tolerance": 0.5}, {"timeout": 0.0}])
def test_with_a_timeout_or_an_option_the_core_is_not_called(tf2_ros, case, further):
    name, core, *_ = case
    buffer = type("Mine", (tf2_ros.Buffer,), {core: mock.Mock(side_effect=AssertionError)})()
    buffer.set_transform_static(transform("map", "robot"), "test")
    asked = ("map", at(0), "robot", at(0), "map") if "full" in name else ("map", "robot", at(0))
    assert getattr(buffer, name)(*asked, **further)


@pytest.mark.parametrize("further", [{}, {"tolerance": 0.5}])
def test_transform_calls_lookup_transform_of_a_subclass(tf2_ros, further):
    looked_up = mock.Mock(return_value=transform("map", "robot"))
    buffer = type("Mine", (tf2_ros.Buffer,), {"lookup_transform": looked_up})()
    point = PointStamped()
    point.header.frame_id = "robot"
    assert buffer.transform(point, "map", 1.0, **further).header.frame_id == "map"
    looked_up.assert_called_once_with("map", "robot", point.header.stamp, 1.0, **further)
