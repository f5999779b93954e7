# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What broadcasters and `tf2_ros.serialization` make of transforms: the bytes of ROS."""

import numpy as np
import pytest
from cdr_encoder import encode
from geometry_msgs.msg import TransformStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from times_and_transforms import transform

from tf2_msgs.msg import TFMessage
from tf2_py._tf2_py import refused_transforms, serialize_as_ros
from tf2_ros.serialization import serialize_arrays, serialize_transforms

MESSAGES = [
    transform("map", "odom", 1.25, (1, 2, 3)),
    transform("odom", "base_link", 1.25, (-1e300, 1e-300, 0.1), (0.5, -0.5, 0.5, 0.5)),
]

text = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
number = st.floats(width=64)
nanoseconds = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)


@settings(max_examples=300)
@given(
    st.lists(
        st.tuples(text, text, nanoseconds, st.tuples(*[number] * 3), st.tuples(*[number] * 4)), max_size=5
    )
)
def test_the_bytes_say_what_the_messages_say(rows):
    messages = [transform(p, c, ns=ns, xyz=xyz, xyzw=xyzw) for p, c, ns, xyz, xyzw in rows]
    data, bad = serialize_as_ros(messages)
    assert bad == refused_transforms(messages)
    # What ROS's own bytes hold in the padding is arbitrary; so they are compared with those of an encoder by
    # the book, in length with ROS's, and by reading them back.
    assert data == encode(messages) == serialize_transforms(messages)
    names, stamps_ns = [(p, c) for p, c, *_ in rows], [ns for _, _, ns, *_ in rows]
    assert serialize_arrays(names, stamps_ns, [[*xyz, *xyzw] for *_, xyz, xyzw in rows]) == data
    assert len(data) == len(serialize_message(TFMessage(transforms=messages)))
    assert repr(deserialize_message(data, TFMessage)) == repr(TFMessage(transforms=messages))


ROW = [0, 0, 0, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ("arrays", "error", "text"),
    [
        (([("a", "b")], [1, 2], [ROW]), ValueError, "frames, stamps and transforms, got 1, 2 and 1"),
        (([], [1], [ROW]), ValueError, "frames, stamps and transforms, got 0, 1 and 1"),
        (([("a", "b\0")], [1], [ROW]), ValueError, "NUL"),
        (([("a", b"b")], [1], [ROW]), TypeError, "expected a str, got bytes"),
        (([("a", "b")], [1], [ROW[1:]]), ValueError, "reshape"),
        (([("a", "b")], [1], [["x", *ROW[1:]]]), ValueError, "'x'"),
        (([("a", "b", "c")], [1], [ROW]), ValueError, "too many values"),
    ],
    ids=str,
)
def test_arrays_that_do_not_fit_are_refused(arrays, error, text):
    with pytest.raises(error, match=text):
        serialize_arrays(*arrays)


@pytest.mark.parametrize("number", [3, True, np.int64(3), np.float32(1.5), np.array(2.5)], ids=repr)
def test_a_number_of_any_type_is_sent_as_a_float(number):
    """ROS would send what the first bytes of the object happen to say."""
    message = transform("map", "odom", 1.5)
    message.transform.rotation._w = message.transform.translation._x = number
    [read] = deserialize_message(serialize_as_ros([message])[0], TFMessage).transforms
    assert read.transform.rotation.w == read.transform.translation.x == float(number)


def test_transforms_are_serialized_one_by_one_or_several_at_once():
    assert serialize_transforms(MESSAGES[0]) == encode(MESSAGES[:1])
    assert serialize_transforms(iter(MESSAGES)) == encode(MESSAGES)
    assert serialize_transforms([]) == encode([])


class Subclass(TransformStamped):
    """A message class of a program's own."""


ODD = {
    "text for a float": lambda m: setattr(m.transform.translation, "_x", "1"),
    "too many nanoseconds": lambda m: setattr(m.header.stamp, "_nanosec", 1_000_000_000),
    "seconds beyond 32 bits": lambda m: setattr(m.header.stamp, "_sec", 2**31),
    "bool for seconds": lambda m: setattr(m.header.stamp, "_sec", True),
    "bytes for a name": lambda m: setattr(m.header, "_frame_id", b"map"),
    "lone surrogate": lambda m: setattr(m, "_child_frame_id", "\ud800"),
}


@pytest.mark.parametrize("change", ODD.values(), ids=ODD)
def test_what_ros_must_decide_is_left_to_ros(change):
    odd = transform("map", "odom", 1.5, (1, 2, 3))
    change(odd)
    for other in (odd, None, Subclass(), odd.header):
        assert serialize_as_ros([MESSAGES[0], other]) is None


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ("text for a float", TypeError, "must be real number, not str"),
        ("seconds beyond 32 bits", OverflowError, "does not fit into the stamp of a message"),
        ("bytes for a name", TypeError, "expected a str, got bytes"),
        ("lone surrogate", ValueError, "surrogate"),
    ],
)
def test_what_no_message_can_hold_is_not_serialized(change, error, text):
    odd = transform("map", "odom", 1.5, (1, 2, 3))
    ODD[change](odd)
    with pytest.raises(error, match=text):
        serialize_transforms([MESSAGES[0], odd])


@pytest.mark.parametrize("other", [None, 3, "map", [MESSAGES[0].header], TransformStamped], ids=str)
def test_what_is_no_transform_is_not_serialized(other):
    with pytest.raises(TypeError, match="expected a geometry_msgs/TransformStamped"):
        serialize_transforms(other)
