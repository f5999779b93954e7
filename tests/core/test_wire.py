"""What broadcasters send: the bytes that ROS itself would have sent."""

import pytest
from encoding import encode
from hypothesis import given, settings
from hypothesis import strategies as st
from making import transform
from rclpy.serialization import deserialize_message, serialize_message

from tf2_msgs.msg import TFMessage
from tf2_py._tf2_py import refused, serialize_transforms

pytestmark = pytest.mark.ours

text = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
number = st.floats(width=64)
nanoseconds = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)


@settings(max_examples=300, deadline=None)
@given(
    st.lists(
        st.tuples(text, text, nanoseconds, st.tuples(*[number] * 3), st.tuples(*[number] * 4)), max_size=5
    )
)
def test_the_bytes_say_what_the_messages_say(rows):
    messages = [transform(p, c, ns=ns, xyz=xyz, xyzw=xyzw) for p, c, ns, xyz, xyzw in rows]
    data, bad = serialize_transforms(messages)
    assert bad == refused(messages)
    # What ROS's own bytes hold in the padding is arbitrary; so they are compared with those of an encoder by
    # the book, in length with ROS's, and by reading them back.
    assert data == encode(messages)
    assert len(data) == len(serialize_message(TFMessage(transforms=messages)))
    assert repr(deserialize_message(data, TFMessage)) == repr(TFMessage(transforms=messages))


def plain():
    return transform("map", "odom", 1.5, (1, 2, 3))


def with_an_odd(change):
    message = plain()
    change(message)
    return message


class Subclass(type(plain())):
    """A message class of a program's own."""


ODD = {
    "int for a float": lambda m: setattr(m.transform.translation, "_x", 1),
    "too many nanoseconds": lambda m: setattr(m.header.stamp, "_nanosec", 1_000_000_000),
    "seconds beyond 32 bits": lambda m: setattr(m.header.stamp, "_sec", 2**31),
    "bool for seconds": lambda m: setattr(m.header.stamp, "_sec", True),
    "NUL in a name": lambda m: setattr(m, "_child_frame_id", "a\0b"),
    "bytes for a name": lambda m: setattr(m.header, "_frame_id", b"map"),
    "lone surrogate": lambda m: setattr(m, "_child_frame_id", "\ud800"),
}


@pytest.mark.parametrize("change", ODD.values(), ids=ODD)
def test_what_ros_must_decide_is_left_to_ros(change):
    assert serialize_transforms([plain(), with_an_odd(change)]) is None


@pytest.mark.parametrize("other", [None, object(), Subclass(), plain().header])
def test_other_objects_are_left_to_ros(other):
    assert serialize_transforms([plain(), other]) is None
