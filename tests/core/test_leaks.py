# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reference counts and memory stay where they were, whatever is done often."""

import math
import pickle
import types

import pytest
from frozen_format import FrozenFile
from leaks import assert_nothing_is_left
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from times_and_transforms import at, transform

from tf2_msgs.msg import TFMessage


@pytest.fixture
def buffer(tf2_py):
    buffer = tf2_py.BufferCore(Duration(seconds=1))
    buffer.set_transforms([transform("map", "odom", 1), transform("odom", "base", 1)], "x")
    return buffer


def raising(call, *args):
    def action():
        try:
            call(*args)
        except Exception:
            return
        raise AssertionError("it did not raise")

    return action


def actions(buffer):
    message = transform("map", "odom", 1.25)
    duck = types.SimpleNamespace(header=message.header, child_frame_id="duck", transform=message.transform)
    data = serialize_message(TFMessage(transforms=[message]))
    second, interval = at(1), Duration(seconds=0)
    return [
        lambda: buffer.set_transform(message, "x"),
        lambda: buffer.set_transform(duck, "x"),
        lambda: buffer.set_transform_static(transform("odom", "plate"), "x"),
        lambda: buffer.set_transforms([message, message], "x"),
        lambda: buffer.set_transforms_cdr(data, "x"),
        lambda: buffer.lookup_transform_core("map", "base", second),
        lambda: buffer.lookup_transform_full_core("map", second, "base", second, "odom"),
        lambda: buffer.can_transform_core("map", "base", at(5)),
        lambda: buffer.get_latest_common_time("map", "base"),
        lambda: buffer.lookupVelocityCore("base", "map", second, interval),
        lambda: buffer._chain("map", second, "base", second, "odom"),
        lambda: buffer._wait("map", "base", at(5)),
        lambda: pickle.loads(pickle.dumps(buffer)),
        buffer.all_frames_as_yaml,
        buffer._getFrameStrings,
        buffer.statistics,
    ]


def failures(buffer):
    spoiled = FrozenFile(buffer.__getstate__()["image"])
    spoiled.change("d", len(spoiled.data) - 64, math.nan)
    return [
        raising(buffer.lookup_transform_core, "map", "nowhere", at(1)),
        raising(buffer.lookup_transform_core, "map", "base", at(5)),
        raising(buffer.lookup_transform_core, "map", b"base", at(5)),
        raising(buffer.set_transforms, [transform("a", "b"), 1], "x"),
        raising(buffer.set_transforms_cdr, b"\0\1\0\0" + b"\xff" * 40, "x"),
        raising(buffer.__setstate__, {"image": spoiled.data}),
    ]


@pytest.mark.parametrize("calls", [actions, failures])
def test_calls_and_errors_leave_nothing_behind(buffer, calls):
    for call in calls(buffer):
        assert_nothing_is_left(call, times=10_000)


def memory(line):
    """A number of bytes that the system notes of this process."""
    with open("/proc/self/status") as status:
        return int(status.read().partition(f"{line}:")[2].split()[0]) * 1024


def test_a_count_that_promises_more_than_the_data_holds_allocates_nothing(buffer):
    data = b"\0\1\0\0" + (2**32 - 1).to_bytes(4, "little") + bytes(2_000_000)
    call = raising(buffer.set_transforms_cdr, data, "x")
    call()
    with open("/proc/self/clear_refs", "w") as peak:
        peak.write("5")  # the peak so far is forgotten
    before = memory("VmRSS")
    call()
    assert memory("VmHWM") - before < 1_000_000
