# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The lookups without options call the methods of BufferCore by name: these can be overridden and patched."""

from unittest import mock

import pytest
from times_and_transforms import at

# What a method calls, what that may return, and what the method then returns.
CASES = {
    "lookup_transform": ("lookup_transform_core", "an answer", "an answer"),
    "can_transform": ("can_transform_core", [1, "a reason"], True),
}
ASKED = ("map", "robot", at(1))


@pytest.fixture(params=CASES)
def case(request):
    return request.param, *CASES[request.param]


def test_by_a_subclass(tf2_ros, case):
    name, core, returned, wanted = case
    asked = []

    def override(self, *arguments):
        asked.append((self, arguments))
        return returned

    buffer = type("Mine", (tf2_ros.Buffer,), {core: override})()
    assert getattr(buffer, name)(*ASKED) == wanted
    assert asked == [(buffer, ASKED)]


@pytest.mark.parametrize("of_class", [False, True])
def test_by_mock(tf2_ros, case, of_class):
    name, core, returned, wanted = case
    buffer = tf2_ros.Buffer()
    with mock.patch.object(tf2_ros.Buffer if of_class else buffer, core, return_value=returned) as patched:
        assert getattr(buffer, name)(*ASKED) == wanted
    patched.assert_called_once_with(*ASKED)


def test_a_patch_with_autospec_gets_the_buffer(tf2_ros, case):
    buffer = tf2_ros.Buffer()
    with mock.patch.object(tf2_ros.Buffer, case[0], autospec=True) as patched:
        getattr(buffer, case[0])(*ASKED)
    patched.assert_called_once_with(buffer, *ASKED)
