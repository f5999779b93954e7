# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The lookups without options, which run no code in Python: they can be overridden and patched as before."""

import copy
import inspect
import pickle
import sys
import types
import typing
import weakref
from unittest import mock

import pytest
from geometry_msgs.msg import PointStamped
from rclpy.duration import Duration
from times_and_transforms import at, transform

from tf2_py.typing import LookupPolicy

# What a method calls in its place, what that may return, and what the method then returns.
CASES = {
    "lookup_transform": ("lookup_transform_core", "an answer", "an answer"),
    "can_transform": ("can_transform_core", [1, "a reason"], True),
}
ASKED = ("map", "robot", at(1))


@pytest.fixture
def buffer(tf2_ros):
    return filled(tf2_ros.Buffer())


def filled(buffer):
    buffer.set_transform(transform("map", "robot", 1, (1, 2, 3)), "me")
    buffer.lookup_transform(*ASKED)  # the first one looks at rclpy's classes
    return buffer


@pytest.fixture(params=CASES)
def case(request):
    return request.param, *CASES[request.param]


def python_calls(call, *arguments, **options):
    """The functions in Python that run during a call."""
    names = []
    sys.setprofile(lambda frame, event, _: event == "call" and names.append(frame.f_code.co_name))
    try:
        call(*arguments, **options)
    finally:
        sys.setprofile(None)
    return names


class TestTaken:
    def test_without_options_no_code_in_python_runs(self, buffer, case, tf2_ros):
        call = getattr(buffer, case[0])
        assert python_calls(call, *ASKED) == []
        assert python_calls(call, *ASKED, tf2_ros.buffer_interface.NO_TIMEOUT) == []
        assert case[0] in python_calls(call, *ASKED, Duration())
        assert case[0] in python_calls(call, *ASKED, tolerance=1)

    def test_transforming_an_object_takes_it(self, buffer):
        point = PointStamped()
        point.header.frame_id = "robot"
        calls = python_calls(buffer.transform, point, "map")
        assert "transform" in calls and "lookup_transform" not in calls

    @pytest.mark.parametrize("given", range(4))
    def test_keywords_give_the_same(self, buffer, case, given):
        call = getattr(buffer, case[0])
        names = ("target_frame", "source_frame", "time")[given:]
        assert call(*ASKED[:given], **dict(zip(names, ASKED[given:], strict=True))) == call(*ASKED)

    @pytest.mark.parametrize("arguments", [(), ASKED[:1], ASKED[:2], (*ASKED, 0.0, False, "too many")])
    def test_a_wrong_number_of_arguments_is_a_type_error_of_the_method(self, buffer, case, arguments):
        with pytest.raises(TypeError, match=rf"^Buffer\.{case[0]}\(\) (missing|takes)"):
            getattr(buffer, case[0])(*arguments)


class TestOverridden:
    def test_by_a_subclass(self, tf2_ros, case):
        name, core, returned, wanted = case
        asked = []

        def override(self, *arguments):
            asked.append((self, arguments))
            return returned

        buffer = type("Mine", (tf2_ros.Buffer,), {core: override})()
        assert getattr(buffer, name)(*ASKED) == wanted
        assert asked == [(buffer, ASKED)]

    def test_by_an_attribute_of_the_buffer(self, buffer, case):
        name, core, returned, wanted = case
        setattr(buffer, core, lambda *arguments: returned if arguments == ASKED else None)
        assert getattr(buffer, name)(*ASKED) == wanted
        delattr(buffer, core)
        assert getattr(buffer, name)(*ASKED) != "an answer"

    def test_by_a_getattribute(self, tf2_ros, case):
        name, core, returned, wanted = case

        class Mine(tf2_ros.Buffer):
            def __getattribute__(self, attribute):
                return (lambda *_: returned) if attribute == core else super().__getattribute__(attribute)

        assert getattr(Mine(), name)(*ASKED) == wanted

    @pytest.mark.parametrize("of_class", [False, True])
    def test_by_mock(self, tf2_ros, buffer, case, of_class):
        name, core, returned, wanted = case
        with mock.patch.object(
            tf2_ros.Buffer if of_class else buffer, core, return_value=returned
        ) as patched:
            assert getattr(buffer, name)(*ASKED) == wanted
        patched.assert_called_once_with(*ASKED)
        assert python_calls(getattr(buffer, name), *ASKED) == []

    def test_the_method_itself_calls_that_of_the_base(self, tf2_ros, case):
        class Mine(tf2_ros.Buffer):
            def lookup_transform(self, *arguments, **options):
                return "mine", super().lookup_transform(*arguments, **options)

            def can_transform(self, *arguments, **options):
                return "mine", super().can_transform(*arguments, **options)

        plain, mine = filled(tf2_ros.Buffer()), filled(Mine())
        assert getattr(mine, case[0])(*ASKED) == ("mine", getattr(plain, case[0])(*ASKED))

    def test_an_error_of_the_override_is_raised(self, tf2_ros, case):
        def override(self, *_):
            raise RuntimeError("mine")

        with pytest.raises(RuntimeError, match="^mine$"):
            getattr(type("Mine", (tf2_ros.Buffer,), {case[1]: override})(), case[0])(*ASKED)

    def test_calling_each_other_is_a_recursion_error(self, tf2_ros, case):
        method = getattr(tf2_ros.Buffer, case[0])
        for core in method, lambda self, *arguments: getattr(self, case[0])(*arguments):
            with pytest.raises(RecursionError):
                getattr(type("Mine", (tf2_ros.Buffer,), {case[1]: core})(), case[0])(*ASKED)


class TestLikeAFunction:
    def test_for_inspect(self, tf2_ros, buffer, case):
        method = getattr(tf2_ros.Buffer, case[0])
        assert inspect.isfunction(method) and inspect.isroutine(method)
        assert inspect.ismethod(getattr(buffer, case[0]))
        assert getattr(buffer, case[0]).__func__ is method
        assert inspect.getdoc(method) == inspect.getdoc(getattr(tf2_ros.BufferInterface, case[0]))
        assert f"def {case[0]}" in inspect.getsource(method)
        assert (method.__name__, method.__module__) == (case[0], "tf2_ros.buffer")
        assert repr(method).startswith(f"<function Buffer.{case[0]} at ")

    def test_its_signature_has_the_options_by_name(self, tf2_ros, buffer, case):
        parameters = inspect.signature(getattr(tf2_ros.Buffer, case[0])).parameters
        named = [one for one in parameters.values() if one.kind is one.KEYWORD_ONLY]
        assert {one.name: one.annotation for one in named} == LookupPolicy.__annotations__
        assert [*inspect.signature(getattr(buffer, case[0])).parameters] == [*parameters][1:]
        defaults = {one.name: one.default for one in named}
        assert getattr(buffer, case[0])(*ASKED, **defaults) == getattr(buffer, case[0])(*ASKED)

    @pytest.mark.parametrize("of_instance", [False, True])
    def test_an_autospec_refuses_what_the_method_refuses(self, tf2_ros, case, of_instance):
        spec = mock.create_autospec(tf2_ros.Buffer, instance=of_instance)
        call = getattr(spec if of_instance else spec(), case[0])
        call(*ASKED, timeout=1.0, tolerance=0.1)
        for arguments, options in ((ASKED, {"timeout_sec": 1.0}), (ASKED[:2], {}), ((*ASKED, 1, 2, 3), {})):
            with pytest.raises(TypeError):
                call(*arguments, **options)

    def test_a_patch_with_autospec_gets_the_buffer(self, tf2_ros, buffer, case):
        original = getattr(tf2_ros.Buffer, case[0])
        with mock.patch.object(tf2_ros.Buffer, case[0], autospec=True) as patched:
            getattr(buffer, case[0])(*ASKED)
        patched.assert_called_once_with(buffer, *ASKED)
        assert getattr(tf2_ros.Buffer, case[0]) is original

    def test_its_attributes_are_those_of_the_function(self, tf2_ros, case):
        method = getattr(tf2_ros.Buffer, case[0])
        method.mine = 1
        assert method.mine == vars(method)["mine"] == 1
        del method.mine
        assert not hasattr(method, "mine")
        assert isinstance(method, typing.Callable)

    def test_it_binds_and_compares_as_itself(self, tf2_ros, buffer, case):
        method = getattr(tf2_ros.Buffer, case[0])
        assert method.__get__(buffer) == getattr(buffer, case[0])
        assert method.__get__(None, tf2_ros.Buffer) is method
        assert method.__call__(buffer, *ASKED) == getattr(buffer, case[0])(*ASKED)
        assert (method.__hash__(), method.__eq__(method)) == (hash(method), True)

    def test_for_pickles_copies_and_weak_references(self, tf2_ros, buffer, case):
        method = getattr(tf2_ros.Buffer, case[0])
        assert pickle.loads(pickle.dumps(method)) is copy.deepcopy(method) is copy.copy(method) is method
        assert weakref.WeakMethod(getattr(buffer, case[0]))()(*ASKED)

    def test_it_can_be_called_with_anything_that_has_the_methods(self, tf2_ros, case):
        name, core, returned, wanted = case
        other = types.SimpleNamespace(**{core: lambda *_: returned})
        assert getattr(tf2_ros.Buffer, name)(other, *ASKED) == wanted
