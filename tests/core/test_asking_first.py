# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A lookup with a timeout or an option first asks, and prepares to wait only if there is no answer."""

import asyncio
from unittest import mock

import pytest
from rclpy.duration import Duration
from times_and_transforms import at, transform

SIMPLE = ("map", "robot", at(0))
FULL = ("map", at(0), "robot", at(0), "map")
CALLS = {
    "lookup_transform": SIMPLE,
    "lookup_transform_full": FULL,
    "can_transform": SIMPLE,
    "can_transform_full": FULL,
}
AWAITS = {"lookup_transform_async": SIMPLE, "lookup_transform_full_async": FULL}


@pytest.fixture
def buffer(tf2_ros):
    made = tf2_ros.Buffer()
    made.set_transform_static(transform("map", "robot"), "test")
    return made


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("timeout", [Duration(seconds=1), 1, 1.0])
def test_an_answer_that_is_available_needs_no_wait(buffer, name, timeout):
    with mock.patch("tf2_ros._wait.lookup_or_wait.Shutdown", side_effect=AssertionError):
        assert getattr(buffer, name)(*CALLS[name], timeout)


@pytest.mark.parametrize("name", AWAITS)
def test_an_await_of_an_answer_that_is_available_makes_no_future(buffer, name):
    with mock.patch("tf2_ros.buffer.TransformFuture", side_effect=AssertionError):
        answer = asyncio.run(getattr(buffer, name)(*AWAITS[name], timeout=1.0))
    assert answer.child_frame_id == "robot"


WRONG = [("1", TypeError), ([], TypeError), (True, TypeError), (at(1), TypeError), (float("nan"), ValueError)]


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize(("timeout", "error"), [*WRONG, (None, TypeError)])
def test_a_wrong_timeout_is_an_error_also_if_the_answer_is_available(buffer, name, timeout, error):
    with pytest.raises(error, match="timeout"):
        getattr(buffer, name)(*CALLS[name], timeout)


@pytest.mark.parametrize("name", AWAITS)
@pytest.mark.parametrize(("timeout", "error"), WRONG)
def test_so_it_is_in_an_await(buffer, name, timeout, error):
    with pytest.raises(error, match="timeout"):
        asyncio.run(getattr(buffer, name)(*AWAITS[name], timeout=timeout))


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("timeout", [0, 0.0, -1, Duration(), Duration(seconds=-1), float("-inf")])
def test_a_timeout_of_zero_or_less_does_not_wait(tf2_ros, buffer, name, timeout):
    assert getattr(buffer, name)(*CALLS[name], timeout)
    buffer.clear()
    buffer.set_transform(transform("map", "robot", 1.0), "test")
    late = [at(2) if one == at(0) else one for one in CALLS[name]]
    with mock.patch("tf2_ros._wait.lookup_or_wait.Shutdown", side_effect=AssertionError):
        if name.startswith("can"):
            assert getattr(buffer, name)(*late, timeout) is False
        else:
            with pytest.raises(tf2_ros.ExtrapolationException):
                getattr(buffer, name)(*late, timeout)


@pytest.mark.parametrize("name", CALLS)
def test_which_error_comes_first(buffer, name):
    others = CALLS[name][1:]
    wrong = ["now" if one == at(0) else one for one in others]
    # The options, then the timeout, then the names and times.
    with pytest.raises(TypeError, match="unexpected keyword argument 'unknown'"):
        getattr(buffer, name)(1, *wrong, "1", tolerance=-1.0, unknown=1)
    with pytest.raises(ValueError, match="tolerance must not be negative"):
        getattr(buffer, name)(1, *wrong, "1", tolerance=-1.0)
    with pytest.raises(TypeError, match="timeout: expected a duration"):
        getattr(buffer, name)(1, *wrong, "1", tolerance=1.0)
    with pytest.raises(TypeError, match="target_frame: expected a str"):
        getattr(buffer, name)(1, *wrong, 1.0)
    with pytest.raises(TypeError, match="time: expected a time"):
        getattr(buffer, name)("map", *wrong, 1.0)
    with pytest.raises(ValueError, match="zz"):  # a limit that could never apply, without waiting
        getattr(buffer, name)(*CALLS[name], 1000.0, tolerance={"zz": 1.0})


@pytest.mark.parametrize("timeout", [{}, {"timeout": 0.0}, {"timeout": 0.001}, {"tolerance": 0.1}])
@pytest.mark.parametrize("name", ["can_transform", "can_transform_full"])
def test_no_reason_is_sought_that_nobody_asks_for(buffer, name, timeout):
    silence = mock.Mock(return_value="")
    buffer.add_source("test", silence)
    unknown = ["unknown" if one == "robot" else one for one in CALLS[name]]
    assert getattr(buffer, name)(*unknown, **timeout) is False
    silence.assert_not_called()
    can, reason = getattr(buffer, name)(*unknown, return_debug_tuple=True, **timeout)
    assert can is False
    assert "unknown" in reason


@pytest.mark.parametrize("name", ["can_transform", "can_transform_full"])
def test_the_method_of_another_buffer_may_replace_it(tf2_ros, buffer, name):
    empty = tf2_ros.Buffer()
    setattr(empty, f"{name}_core", getattr(buffer, f"{name}_core"))
    assert getattr(empty, name)(*CALLS[name]) is True


def test_a_message_of_a_filter_with_its_transform_needs_no_wait(buffer):
    from geometry_msgs.msg import PointStamped

    from tf2_ros._wait.filtered_messages import FilterCalls, FilteredMessage
    from tf2_ros.message_filter import FilterFailureReason

    calls = FilterCalls(FilterFailureReason)
    queued = FilteredMessage(calls, None, PointStamped(), "robot", 0, None, None)
    assert queued.at_once(buffer, [("map", 0), ("robot", 0)], None).child_frame_id == "robot"
    assert queued.at_once(buffer, [("map", 0), ("unknown", 0)], None) is None
