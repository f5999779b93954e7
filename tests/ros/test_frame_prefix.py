# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prefixes of frame names for several robots in one buffer: of listeners, transforms, filters and clients."""

import asyncio

import pytest
from geometry_msgs.msg import PointStamped
from rclpy.serialization import serialize_message
from std_msgs.msg import Header
from times_and_transforms import S, at, transform, translation
from waiting import until

from tf2_msgs.msg import TFMessage
from tf2_ros import InvalidArgumentException, LookupException, MessageFilter

LATEST = at(0)


def test_names_are_as_in_a_message_that_was_written_with_the_prefix(tf2_ros, node, executor, peer, inserter):
    """Names of all lengths, a leading slash, and several transforms in one message."""
    names = ["b", "/slash", "n" * 700, "ü", "a b", "//two", "/", ""]
    message = TFMessage(transforms=[transform("map", name, 1, (i, 0, 0)) for i, name in enumerate(names)])
    message.transforms.append(transform("n" * 700, "last", 1))
    buffer, expected = tf2_ros.Buffer(), tf2_ros.Buffer()
    for one in message.transforms:
        parent, child = (
            name and "robot/" + name.removeprefix("/") if name != "/" else ""
            for name in (one.header.frame_id, one.child_frame_id)
        )
        written = transform(parent, child, 1, translation(one))
        expected.set_transform(written, "x")
    with tf2_ros.TransformListener(buffer, node, prefix="robot/"):
        peer().send_bytes(bytes(serialize_message(message)))
        until(lambda: "robot/last" in buffer, executor)
        for name in expected.frames():
            if name != "robot/map":
                assert buffer.lookup_transform("robot/map", name, at(1)) == expected.lookup_transform(
                    "robot/map", name, at(1)
                )
        assert buffer.frames().keys() == expected.frames().keys()
        assert buffer.statistics()["refused"] == expected.statistics()["refused"]


def test_a_recording_has_the_names_of_the_buffer(tf2_ros, node, peer):
    from tf2_ros.records import Recording

    buffer, recording = tf2_ros.Buffer(), Recording()
    with tf2_ros.TransformListener(buffer, node, prefix="robot/", recording=recording):
        peer().send(("map", "base", S, 1.0))
        until(lambda: buffer.can_transform("robot/map", "robot/base", LATEST))
        assert set(recording.frames()) >= {"robot/map", "robot/base"}


@pytest.mark.parametrize("static", [False, True], ids=["/tf", "/tf_static"])
@pytest.mark.parametrize("prefix", ["robot/", "/robot/", "/", "//robot/"])
def test_one_leading_slash_of_the_resulting_names_is_removed(
    tf2_ros, node, executor, peer, inserter, prefix, static
):
    buffer = tf2_ros.Buffer()
    with tf2_ros.TransformListener(buffer, node, prefix=prefix):
        peer().send(("/map", "base", S, 1.0), static=static)
        until(lambda: buffer.frames(), executor)
        put_before = prefix.removeprefix("/")
        assert {*buffer.frames()} == {f"{put_before}map", f"{put_before}base"}
        assert buffer.frames()[f"{put_before}base"].static is static


@pytest.mark.parametrize(("prefix", "error"), [("a\0", ValueError), (1, TypeError)])
def test_an_invalid_one_is_refused(tf2_ros, node, prefix, error):
    with pytest.raises(error, match="prefix: expected"):
        tf2_ros.TransformListener(tf2_ros.Buffer(), node, prefix=prefix)


# Messages, whose frames have no prefix.


def stamped(frame, x=1.0):
    message = PointStamped(header=Header(frame_id=frame, stamp=at(1).to_msg()))
    message.point.x = x
    return message


@pytest.fixture
def fleet(tf2_ros):
    """Two robots with the same names of frames: robot1 is at x = 10 in the site, robot2 at x = 20."""
    buffer = tf2_ros.Buffer()
    for number in (1, 2):
        buffer.set_transform(transform("site", f"robot{number}/base", 1, (10 * number, 0, 0)), "me")
        buffer.set_transform(transform("site", f"robot{number}/base", 2, (10 * number, 0, 0)), "me")
    return buffer


# By the method: how a buffer transforms a message into "site".
TRANSFORMS = {
    "transform": lambda b, message, **how: b.transform(message, "site", **how),
    "transform_full": lambda b, message, **how: b.transform_full(message, "site", at(2), "site", **how),
    "transform_async": lambda b, message, **how: asyncio.run(b.transform_async(message, "site", **how)),
}
every_method = pytest.mark.parametrize("method", TRANSFORMS.values(), ids=TRANSFORMS)


@every_method
@pytest.mark.parametrize("frame", ["base", "/base"])
def test_a_message_is_transformed_from_the_frame_with_the_prefix(fleet, method, frame):
    for number in (1, 2):
        message = stamped(frame)
        for prefix in (f"robot{number}/", f"/robot{number}/"):
            moved = method(fleet, message, prefix=prefix)
            assert (moved.header.frame_id, moved.point.x) == ("site", 10 * number + 1)
        assert message == stamped(frame)


def test_the_target_frame_is_a_whole_name(fleet):
    moved = fleet.transform(stamped("base"), "robot2/base", prefix="robot1/")
    assert (moved.header.frame_id, moved.point.x) == ("robot2/base", -9.0)
    with pytest.raises(LookupException, match=r"\"robot1/wheel\".*does not exist"):
        fleet.transform(stamped("wheel"), "site", prefix="robot1/")


@every_method
def test_a_prefix_goes_with_the_other_arguments(fleet, method):
    late = stamped("base")
    late.header.stamp = at(2.5).to_msg()
    how = {"prefix": "robot1/", "tolerance": 1.0, "new_type": PointStamped}
    assert method(fleet, late, **how).point.x == 11.0


@every_method
def test_without_a_frame_a_prefix_names_none(fleet, method):
    for frame in ("", "/"):
        with pytest.raises(InvalidArgumentException, match="frame"):
            method(fleet, stamped(frame), prefix="robot1/")


@every_method
@pytest.mark.parametrize(("prefix", "error"), [("a\0", ValueError), (1, TypeError), (b"robot1/", TypeError)])
def test_an_invalid_prefix_of_messages_is_refused(fleet, node, method, prefix, error):
    with pytest.raises(error, match="prefix: expected a str"):
        method(fleet, stamped("base"), prefix=prefix)
    with pytest.raises(error, match="prefix: expected a str"):
        MessageFilter(None, fleet, "site", 10, node=node, prefix=prefix)


def test_a_filter_waits_for_the_frame_with_the_prefix(tf2_ros, node):
    buffer, passed = tf2_ros.Buffer(), []
    with tf2_ros.MessageFilter(None, buffer, "site", 10, node=node, prefix="/robot1/") as points:
        points.registerCallback(passed.append)
        for frame in ("base", "/base", "other"):
            points.add(stamped(frame))
        buffer.set_transform(transform("site", "base", 1), "me")
        buffer.set_transform(transform("site", "robot2/base", 1), "me")
        assert passed == []
        buffer.set_transform(transform("site", "robot1/base", 1), "me")
        assert passed == [stamped("base"), stamped("/base")]
        assert points.statistics()["waiting"] == 1


def test_a_filter_with_a_prefix_drops_a_message_without_a_frame(tf2_ros, node, fleet):
    reasons = []
    with tf2_ros.MessageFilter(None, fleet, "site", 10, node=node, prefix="robot1/") as points:
        points.registerFailureCallback(lambda message, reason: reasons.append(reason))
        points.add(stamped(""))
        points.add(stamped("/"))
    assert reasons == [tf2_ros.FilterFailureReason.EMPTY_FRAME_ID] * 2


def test_an_iteration_over_a_filter_yields_the_transform_of_the_frame_with_the_prefix(tf2_ros, node, fleet):
    async def first():
        with tf2_ros.MessageFilter(None, fleet, "site", 10, node=node, prefix="robot2/") as points:
            stream = aiter(points)
            points.add(stamped("base"))
            return await anext(stream)

    message, found = asyncio.run(first())
    assert (message, found.child_frame_id) == (stamped("base"), "robot2/base")


def test_a_client_asks_for_the_frame_with_the_prefix(tf2_ros):
    asked = []

    class Asking(tf2_ros.BufferInterface):
        def lookup_transform(self, target_frame, source_frame, time, timeout=None):
            asked.append((target_frame, source_frame))
            return transform(target_frame, source_frame, 1)

    Asking().transform(stamped("base"), "site", prefix="robot1/")
    Asking().transform(stamped("base"), "site")
    assert asked == [("site", "robot1/base"), ("site", "base")]
