# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What programs find in error texts with regular expressions, greedy ones included."""

import math
import re
from types import SimpleNamespace

import pytest
from times_and_transforms import at, transform

ENDS = {"future": ("base", "map"), "past": ("base", "map"), "single": ("once", "map")}
# Expressions of public programs, and what each finds in the error of a lookup, by its cause.
PATTERNS = {
    r"extrapolation into the future\.  Requested time ([\d.]+) but the latest data is at": {"future": (9,)},
    r"extrapolation into the past\.  Requested time ([\d.]+) but the earliest data is at": {"past": (0.5,)},
    r"Requested time ([\d.]+) but the latest data is at time ([\d.]+)": {"future": (9, 3.5)},
    r"Requested time ([\d.]+) but the earliest data is at time ([\d.]+)": {"past": (0.5, 1.5)},
    r"Requested time (.*) but the (.*) data is at time (.*), when looking up": {
        "future": (9, "latest", 3.5),
        "past": (0.5, "earliest", 1.5),
    },
    r"data is at time (.*),": {"future": (3.5,), "past": (1.5,)},
    r"extrapolation at time ([\d.]+), but only time ([\d.]+) is in the buffer": {"single": (6, 5)},
    r"when looking up transform from frame \[(.*)\] to frame \[(.*)\]": ENDS,
    r"frame \[(.*)\] to frame \[(.*)\]": ENDS,
    r".*\[(.*)\]": dict.fromkeys(ENDS, ("map",)),
    r"Could not find a connection between '(.*)' and '(.*)' .* (not part of the same tree)": {
        "connection": ("map", "crater", "not part of the same tree")
    },
    r"'(.*)' and '(.*)'": {"connection": ("map", "crater")},
    r'"(.*)"': {},
    r"(does not exist|cannot be empty|cannot start with|contains a loop)": {},
}
SILENCE = "nothing has been received on /tf_static and nothing on /tf for 12 s"


def number(text):
    try:
        return float(text)
    except ValueError:
        return text


def found(text):
    """What the patterns find in a text, numbers as numbers."""
    matches = {pattern: re.search(pattern, text, re.DOTALL) for pattern in PATTERNS}
    return {pattern: tuple(map(number, match.groups())) for pattern, match in matches.items() if match}


@pytest.fixture
def buffer(tf2_py):
    buffer = tf2_py.BufferCore()
    for seconds in (1, 2, 3):
        buffer.set_transform(transform("map", "odom", seconds), "x")
        buffer.set_transform(transform("odom", "base", seconds + 0.5), "x")
    buffer.set_transform(transform("map", "once", 5), "x")
    buffer.set_transform(transform("moon", "crater", 1), "x")
    return buffer


@pytest.mark.tf2
@pytest.mark.parametrize(
    ("cause", "source", "seconds"),
    [("future", "base", 9), ("past", "base", 0.5), ("single", "once", 6), ("connection", "crater", 1)],
)
def test_what_is_found_in_the_error_of_a_lookup_and_the_reason_of_a_can_transform(
    tf2_py, buffer, cause, source, seconds
):
    def error():
        with pytest.raises(tf2_py.TransformException) as caught:
            buffer.lookup_transform_core("map", source, at(seconds))
        return str(caught.value)

    wanted = {pattern: groups[cause] for pattern, groups in PATTERNS.items() if cause in groups}
    possible, reason = buffer.can_transform_core("map", source, at(seconds))
    assert (possible, found(reason), found(error())) == (0, wanted, wanted)
    if hasattr(buffer, "_describe_silence_with"):
        # Silent topics are said at the end.
        buffer._describe_silence_with(lambda _: (SILENCE, SILENCE))
        assert found(error()) == wanted
        assert (SILENCE[1:] in error()) == (cause != "past")


def error_of(tf2_py, buffer, target, source, seconds):
    with pytest.raises(tf2_py.ExtrapolationException) as raised:
        buffer.lookup_transform_core(target, source, at(seconds))
    assert buffer.can_transform_core(target, source, at(seconds)) == (0, str(raised.value))
    return str(raised.value)


@pytest.fixture
def robot(tf2_ros):
    def ending_at(newest):
        buffer = tf2_ros.Buffer()
        for parent, child in (("map", "base"), ("base", "arm"), ("arm", "laser"), ("base", "cam")):
            for stamp in range(10, newest.get(child, 20) + 1):
                buffer.set_transform(transform(parent, child, stamp), "x")
        return buffer

    return ending_at


def test_an_error_at_the_latest_common_time_names_the_frame_without_newer_data(tf2_py, buffer):
    for seconds in (8, 9):
        buffer.set_transform(transform("odom", "late", seconds), "x")
    said = error_of(tf2_py, buffer, "map", "late", 0)
    reason = ". The latest common time is 3.000000000 because odom has no newer data"
    assert said == error_of(tf2_py, buffer, "map", "late", 3) + reason
    assert found(said)[r"data is at time (.*),"] == (8,)
    for look_up in (
        lambda: buffer.lookup_transform_full_core("odom", at(3), "late", at(0), "map"),
        lambda: buffer.lookup_transform_full_core("late", at(0), "odom", at(3), "map"),
        lambda: buffer.lookup_transforms("map", "late", [0]),
        lambda: buffer.time_range("map", "late"),
        lambda: buffer.path("map", "late", at(0)),
    ):
        with pytest.raises(tf2_py.ExtrapolationException) as raised:
            look_up()
        assert str(raised.value).endswith(f"s too new{reason}")


DAY = 86400
SPANS = [
    (DAY - 1, "86399.000000000 s"),
    (DAY, "1 day"),
    (3.5 * DAY, "3.5 days"),
    (-3.5 * DAY, "3.5 days"),
    (365 * DAY, "365 days"),
    (1_700_000_000, "53.9 years"),
    (-1_700_000_000, "53.9 years"),
]


@pytest.mark.parametrize(("later", "span"), SPANS)
def test_a_span_of_a_day_or_more_is_said_in_days_or_years(tf2_py, later, span):
    buffer, newest = tf2_py.BufferCore(), 400_000_000 if later > 0 else 2_000_000_000
    for stamp in (newest, newest + 1):
        buffer.set_transform(transform("map", "base", stamp), "x")
    said = error_of(tf2_py, buffer, "map", "base", newest + later + (later > 0))
    assert f" is {span} too {'old' if later > 0 else 'new'}" in said


def test_so_is_an_age_a_gap_and_how_far_a_time_is_ahead_of_the_clock(tf2_ros):
    buffer, newest = tf2_ros.Buffer(math.inf), 1_600_000_000 + 7 * DAY
    buffer.clock = SimpleNamespace(now=lambda: at(newest + 2 * DAY))
    for stamp in (1_600_000_000, newest):
        buffer.set_transform(transform("map", "base", stamp), "x")
    for text, time, policy in (
        (r"interpolation across 7 days, .* further apart than max_gap, 1\.0+ s$", newest - 1, {"max_gap": 1}),
        (r"is 2 days old by the clock of the buffer, at .*; max_age allows 5\.0+ s$", 0, {"max_age": 5}),
        (r"the requested time is 5 days ahead of the clock of the buffer$", newest + 7 * DAY, {}),
    ):
        with pytest.raises(tf2_ros.ExtrapolationException, match=text):
            buffer.lookup_transform("map", "base", at(time), **policy)
    assert ", newest 2 days old, " in str(buffer.explain("map", "base", 0))
    assert " (gap 7 days), newest 2 days old, " in str(buffer.explain("map", "base", at(newest - 1)))


def test_a_tolerance_that_is_too_short_names_the_frame_that_is_furthest_behind(tf2_ros, robot):
    buffer = robot({"base": 10, "arm": 11, "laser": 14, "cam": 16})
    for tolerance in (2, 5, {"laser": 9, "arm": 5}):
        with pytest.raises(
            tf2_ros.ExtrapolationException,
            match=r"of arm \(parent base\) at 11\.0+ is 6\.0+ s too old; tolerance allows (2|5)\.0+ s$",
        ) as raised:
            buffer.lookup_transform("cam", "laser", at(17), tolerance=tolerance)
        assert f"{tolerance if tolerance == 2 else 5}.000000000 s" in str(raised.value)
    with pytest.raises(tf2_ros.ExtrapolationException, match=r"of laser .* is 3\.0+ s too old$"):
        buffer.lookup_transform("cam", "laser", at(17), tolerance={"arm": 9, "cam": 5})
    assert buffer.can_transform("cam", "laser", at(17), tolerance=6)
