# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Velocities of frames. What a twist is says the model (test_buffer_beside_model.py)."""

import pytest
from messages_with_or_without_ros import Duration
from times_and_transforms import S, at, transform

from tf2_py import BufferCore

ZERO, BACKWARDS = Duration(), Duration(nanoseconds=-1)
WRONG = {
    "three numbers|values to unpack": [
        lambda b: b.lookupVelocityFullCore("base", "map", "map", (1.0, 2.0), "base", at(3), ZERO)
    ],
    "averaging_interval": [lambda b: b.lookupVelocityCore("base", "map", at(3), "0.5")],
    "averaging_interval: expected 0 or more, got -0.000000001 s": [
        lambda b: b.lookupVelocityCore("base", "map", at(3), BACKWARDS)
    ],
}


def test_after_the_latest_common_time_an_interval_ends_at_the_time():
    # In map until 4 s, later in odom, whose pose in map ends at 2 s.
    buffer = BufferCore(Duration(seconds=100))
    for parent, stamps in (("map", range(1, 5)), ("odom", range(5, 9))):
        buffer.set_transforms([transform(parent, "base", t, (t * t, 0, 0)) for t in stamps], "x")
    buffer.set_transforms([transform("map", "odom", t) for t in (1, 2)], "x")
    assert buffer.get_latest_common_time("map", "base").nanoseconds == 2 * S
    for seconds, x in ((2, 3.0), (2.5, 4.0), (3, 5.0), (4, 7.0)):
        linear, _ = buffer.lookupVelocityCore("base", "map", at(seconds), Duration(seconds=2))
        assert linear == (pytest.approx(x), 0, 0), seconds


@pytest.mark.parametrize("text", WRONG)
def test_wrong_arguments(text):
    buffer = BufferCore()
    buffer.set_transforms([transform("map", "base", t) for t in (2, 4)], "x")
    for call in WRONG[text]:
        with pytest.raises((TypeError, ValueError), match=text):
            call(buffer)
