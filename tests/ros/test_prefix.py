"""Listeners that put a prefix before the names of frames, for several robots in one buffer."""

import pytest
from making import S, at, transform, translation
from processes import until
from rclpy.serialization import serialize_message
from sharing import new_name

from tf2_msgs.msg import TFMessage

pytestmark = pytest.mark.ours
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


def test_readers_of_a_shared_buffer_get_the_names_of_its_owner(tf2_ros, node, peer):
    name = new_name()
    owner = tf2_ros.Buffer(share=name)
    with tf2_ros.TransformListener(owner, node, prefix="robot/"):
        reader = tf2_ros.Buffer(attach=name)
        peer().send(("map", "base", S, 1.0))
        until(lambda: reader.can_transform("robot/map", "robot/base", LATEST))
        assert "map" not in reader


@pytest.mark.parametrize("prefix", ["/robot/", "/", "//robot/"])
def test_one_leading_slash_of_the_resulting_names_is_removed(tf2_ros, node, executor, peer, inserter, prefix):
    buffer = tf2_ros.Buffer()
    with tf2_ros.TransformListener(buffer, node, prefix=prefix):
        peer().send(("/map", "base", S, 1.0))
        until(lambda: buffer.frames(), executor)
        assert {*buffer.frames()} == {f"{prefix[1:]}map", f"{prefix[1:]}base"}


@pytest.mark.parametrize(("prefix", "error"), [("a\0", ValueError), (1, TypeError)])
def test_an_invalid_one_is_refused(tf2_ros, node, prefix, error):
    with pytest.raises(error, match="prefix: expected"):
        tf2_ros.TransformListener(tf2_ros.Buffer(), node, prefix=prefix)
