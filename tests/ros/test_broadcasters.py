# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Broadcasters: what they send, and how."""

import math
from functools import partial

import pytest
from calls_in_threads import at_once
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from times_and_transforms import transform, translation
from waiting import until

from tf2_msgs.msg import TFMessage

LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def subscribe(node):
    """The messages on a topic, from now on."""

    def listen(topic):
        messages = []
        node.create_subscription(TFMessage, topic, messages.append, LATCHED if "static" in topic else 10)
        return messages

    return listen


def children(message):
    return [one.child_frame_id for one in message.transforms]


@pytest.fixture
def broadcaster(tf2_ros, node):
    return tf2_ros.StaticTransformBroadcaster(node)


@pytest.mark.tf2
def test_a_subclass_may_publish_elsewhere(tf2_ros, node, subscribe, executor):
    class Elsewhere(tf2_ros.TransformBroadcaster):
        def __init__(self):
            self.pub_tf = node.create_publisher(TFMessage, "/elsewhere", 10)

    messages, broadcaster = subscribe("/elsewhere"), Elsewhere()
    until(lambda: broadcaster.pub_tf.get_subscription_count() == 1, executor)
    broadcaster.sendTransform(transform("map", "robot", 1))
    until(lambda: messages, executor)


def test_its_quality_of_service(tf2_ros, node):
    dynamic, static = tf2_ros.TransformBroadcaster, tf2_ros.StaticTransformBroadcaster
    for publisher, *wanted in (
        (dynamic(node).pub_tf, "/tf", 100, DurabilityPolicy.VOLATILE),
        (dynamic(node, QoSProfile(depth=4)).pub_tf, "/tf", 4, DurabilityPolicy.VOLATILE),
        (dynamic(node, 4).pub_tf, "/tf", 4, DurabilityPolicy.VOLATILE),
        (static(node).pub_tf, "/tf_static", 1, DurabilityPolicy.TRANSIENT_LOCAL),
    ):
        qos = publisher.qos_profile
        assert [publisher.topic_name, qos.depth, qos.durability] == wanted
        assert qos.history == HistoryPolicy.KEEP_LAST


ZERO = (0.0, 0.0, 0.0, 0.0)
REFUSED = [
    (transform("map", "robot", 1, xyzw=ZERO), "TF_DENORMALIZED_QUATERNION", "too short or too long"),
    (transform("", "robot", 1), "TF_NO_FRAME_ID", "frame_id is not set"),
    (transform("map", "", 1), "TF_NO_CHILD_FRAME_ID", "child_frame_id is not set"),
    (transform("robot", "/robot", 1), "TF_SELF_TRANSFORM", "are the same"),
    (transform("map", "robot", 1, (math.nan, 0, 0)), "TF_NAN_INPUT", "a number is NaN"),
    (transform("map", "robot", 1, (math.inf, 0, 0)), "TF_INFINITE_INPUT", "infinite"),
    (transform("map", "robot", -1), "TF_NEGATIVE_STAMP", "negative"),
    (transform("map", "NO_PARENT", 1), "TF_RESERVED_FRAME_ID", "reserved"),
]


@pytest.mark.parametrize("name", ["TransformBroadcaster", "StaticTransformBroadcaster"])
class TestWhatEveryListenerRefuses:
    @pytest.fixture
    def new(self, tf2_ros, name, node):
        return lambda **options: getattr(tf2_ros, name)(node, **options)

    @pytest.fixture
    def received(self, name, subscribe):
        return subscribe("/tf_static" if name.startswith("Static") else "/tf")

    @pytest.mark.parametrize(("bad", "tag", "why"), REFUSED)
    def test_it_is_what_a_buffer_refuses(self, new, name, bad, tag, why, buffer):
        insert = buffer.set_transform_static if name.startswith("Static") else buffer.set_transform
        insert(bad, "test")
        assert sum(buffer.statistics()["refused"].values()) == 1
        with pytest.raises(ValueError) as caught:
            new(strict=True).sendTransform(bad)
        text = str(caught.value)
        assert text.startswith(f"{tag}: buffers refuse the transform from ") and why in text
        assert f"frame_id '{bad.header.frame_id}' to child_frame_id '" in text

    def test_strict_sends_nothing_of_the_call(self, new, received, executor):
        broadcaster = new(strict=True)
        until(lambda: broadcaster.pub_tf.get_subscription_count() == 1, executor)
        bad, good = transform("map", "bad", 1, xyzw=ZERO), transform("map", "good", 1)
        with pytest.raises(ValueError, match="child_frame_id 'bad'"):
            broadcaster.sendTransform(iter([transform("map", "first", 1), bad]))
        broadcaster.sendTransform(good)
        until(lambda: received, executor)
        assert [children(message) for message in received] == [["good"]]

    def test_otherwise_it_is_sent_with_one_warning_for_each_child(self, new, received, executor, capfd):
        broadcaster = new()
        until(lambda: broadcaster.pub_tf.get_subscription_count() == 1, executor)
        bad = [transform("map", child, 1, xyzw=ZERO) for child in ("a", "b")]
        for sent in (bad[0], bad[0], [*bad, transform("map", "good", 1)]):
            broadcaster.sendTransform(sent)
        until(lambda: received and children(received[-1]) == ["a", "b", "good"], executor)
        first, second = [line for line in capfd.readouterr().err.splitlines() if "buffers refuse" in line]
        assert "child_frame_id 'a' because the rotation is too short" in first
        assert "child_frame_id 'b'" in second and "strict=True" in second

    def test_good_transforms_are_sent_without_a_word(self, new, capfd):
        for strict in (False, True):
            new(strict=strict).sendTransform([transform("/map", "robot", 0, xyzw=(0, 0, 0, 7))])
        assert capfd.readouterr().err == ""


class TestStatic:
    def test_a_late_subscriber_gets_all_that_was_sent(self, broadcaster, subscribe, executor):
        broadcaster.sendTransform(transform("map", "a", 0, (1, 0, 0)))
        broadcaster.sendTransform([transform("map", "b"), transform("map", "c")])
        broadcaster.sendTransform(transform("odom", "a", 0, (2, 0, 0)))  # replaces the first
        messages = subscribe("/tf_static")
        until(lambda: messages, executor)
        assert children(messages[-1]) == children(broadcaster.net_message) == ["a", "b", "c"]
        replaced = messages[-1].transforms[0]
        assert (replaced.header.frame_id, translation(replaced)) == ("odom", (2, 0, 0))

    def test_threads_that_send_at_the_same_time_lose_nothing(self, broadcaster, subscribe, executor):
        names = [[f"{thread}_{i}" for i in range(100)] for thread in "abcd"]

        def send(own):
            for name in own:
                broadcaster.sendTransform(transform("map", name))

        at_once(*(partial(send, own) for own in names))
        expected = sorted(sum(names, []))
        assert sorted(children(broadcaster.net_message)) == expected
        messages = subscribe("/tf_static")
        until(lambda: messages, executor)
        assert sorted(children(messages[-1])) == expected, "the message published last holds all"

    def test_a_message_that_is_filled_in_again_changes_nothing_sent(self, broadcaster):
        message = transform("map", "a", 0, (1, 0, 0))
        broadcaster.sendTransform(message)
        message.child_frame_id = "b"
        message.transform.translation.x = 2.0
        broadcaster.sendTransform(message)
        sent = [(m.child_frame_id, m.transform.translation.x) for m in broadcaster.net_message.transforms]
        assert sent == [("a", 1.0), ("b", 2.0)]

    def test_a_slash_at_the_beginning_makes_no_other_frame(self, broadcaster):
        for x, name in enumerate(("/dock", "dock", "/dock")):
            broadcaster.sendTransform(
                [transform("map", name, 0, (-1, 0, 0)), transform("map", name, 0, (x, 0, 0))]
            )
            sent = [(m.child_frame_id, m.transform.translation.x) for m in broadcaster.net_message.transforms]
            assert sent == [(name, x)]

    @pytest.mark.parametrize("name", [None, b"a", "\ud800"], ids=repr)
    def test_one_that_cannot_be_sent_is_not_kept(self, broadcaster, subscribe, executor, name):
        broadcaster.sendTransform(transform("map", "a"))
        bad = transform("map", "b")
        bad._child_frame_id = name  # the setter takes only a str, where rclpy checks types
        with pytest.raises((TypeError, ValueError)):
            broadcaster.sendTransform([transform("map", "c"), bad])
        broadcaster.sendTransform(transform("map", "d"))
        messages = subscribe("/tf_static")
        until(lambda: messages, executor)
        assert children(messages[-1]) == children(broadcaster.net_message) == ["a", "d"]
