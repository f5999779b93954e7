# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every error that a lookup raises, caught by the names of tf2_ros and by those of tf2_py."""

import enum
import re
import sys

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time

import tf2_py
import tf2_py as tf2
import tf2_ros


class Recovery(enum.Enum):
    WAIT = "wait for data"
    DROP = "drop it"
    CHECK_NAMES = "check the names"
    CHECK_TREE = "check the tree"


def recovery(error):
    """What a program does after an error, by its class."""
    try:
        raise error
    except tf2_ros.ExtrapolationException:
        return Recovery.WAIT if "future" in str(error) else Recovery.DROP
    except (tf2_ros.LookupException, tf2_ros.InvalidArgumentException):
        return Recovery.CHECK_NAMES
    except tf2_ros.ConnectivityException:
        return Recovery.CHECK_TREE


def new_buffer():
    buffer = tf2_ros.Buffer()
    for sec in (10, 20):
        for parent, child in (("map", "odom"), ("odom", "base")):
            t = TransformStamped()
            t.header.stamp.sec = sec
            t.header.frame_id, t.child_frame_id = parent, child
            t.transform.rotation.w = 1.0
            buffer.set_transform(t, "catching")
    stray = TransformStamped(child_frame_id="crater")
    stray.header.frame_id, stray.header.stamp.sec, stray.transform.rotation.w = "moon", 15, 1.0
    buffer.set_transform(stray, "catching")
    return buffer


CASES = [
    ("LookupException", "map", "nowhere", 15),
    ("LookupException", "nowhere", "map", 15),
    ("ConnectivityException", "map", "crater", 15),
    ("ExtrapolationException", "map", "base", 25),
    ("ExtrapolationException", "map", "base", 5),
    ("ExtrapolationException", "moon", "crater", 16),
    ("InvalidArgumentException", "map", "", 15),
    ("InvalidArgumentException", "", "map", 15),
    ("InvalidArgumentException", "/map", "base", 15),
    ("InvalidArgumentException", "map", "/base", 15),
]

# What programs look for in the texts.
PHRASES = {
    "unknown": r'"(\w+)" passed to lookupTransform argument (\w+) does not exist',
    "unconnected": r"'(\w+)' and '(\w+)' because they are not part of the same tree",
    "extrapolation": r"extrapolation into the (\w+)",
    "requested": r"Requested time (\d+)\.\d+ but the (\w+) data is at time (\d+)\.\d+",
    "only one": r"extrapolation at time (\d+)\.\d+, but only time (\d+)\.\d+ is in the buffer",
    "frames": r"from frame \[(\w+)\] to frame \[(\w+)\]",
    "invalid": r'Invalid argument "(.*)" passed to (\w+) argument (\w+)',
    "empty": r"(cannot be empty)",
    "slash": r"(cannot start with a '/')",
}


def found_in(text):
    found = ((name, re.search(pattern, text)) for name, pattern in PHRASES.items())
    return {name: match.groups() for name, match in found if match}


def catch(buffer, module, name, *question):
    try:
        buffer.lookup_transform(*question)
    except getattr(module, name) as error:
        return error
    sys.exit(f"{name} was not raised for {question}")


def main():
    buffer = new_buffer()
    for name, target, source, sec in CASES:
        by_ros = catch(buffer, tf2_ros, name, target, source, Time(seconds=sec))
        by_py = catch(buffer, tf2_py, name, target, source, Time(seconds=sec), Duration())
        base = catch(buffer, tf2, "TransformException", target, source, Time(seconds=sec))
        assert type(by_ros) is type(by_py) is type(base)
        print(f"{source or 'nothing'} in {target or 'nothing'} at {sec}: {type(by_ros).__name__},", end=" ")
        print(recovery(by_ros).value)
        print("   ", found_in(str(by_py)))

    print("classes")
    names = ["TransformException", *sorted({name for name, *_ in CASES}), "TimeoutException"]
    for name in names:
        kind = getattr(tf2_ros, name)
        bases = [base.__name__ for base in kind.__mro__]
        print("   ", name, kind is getattr(tf2_py, name), bases[1:])
    for name in names:
        try:
            raise getattr(tf2_ros, name)("my own text")
        except tf2.TransformException as error:
            print("   ", repr(error), error.args, isinstance(error, tf2_ros.TransformException))

    print("others")
    try:
        buffer.get_latest_common_time("map", "crater")
    except tf2_ros.TransformException as error:
        print("    common time:", type(error).__name__)
    try:
        buffer.get_latest_common_time("map", "nowhere")
    except tf2_ros.TransformException as error:
        print("    common time:", type(error).__name__)
    try:
        buffer.lookup_transform("map", "nowhere", Time(), timeout=Duration(seconds=0.1))
    except Exception as error:  # as cautious programs do
        print("    with a timeout:", type(error).__name__)
    try:
        buffer.lookup_transform_full("map", Time(), "base", Time(), "nowhere")
    except (tf2_ros.LookupException, tf2_ros.ConnectivityException, tf2_ros.ExtrapolationException) as error:
        print("    fixed frame:", type(error).__name__, found_in(str(error)))
    ok, text = buffer.can_transform("map", "nowhere", Time(), return_debug_tuple=True)
    print("    can:", bool(ok), "does not exist" in text, bool(buffer.can_transform("map", "/base", Time())))
    for wrong in (15.0, "now", None):
        try:
            buffer.lookup_transform_core("map", "base", wrong)
        except tf2_ros.TransformException:
            print("    a wrong time is no transform's fault")
        except (TypeError, AttributeError) as error:
            print(f"    time {wrong!r}:", type(error).__name__)


if __name__ == "__main__":
    rclpy.init()
    main()
    rclpy.shutdown()
