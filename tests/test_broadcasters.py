"""Broadcasters: what they send, and how."""

import threading

import pytest
from making import transform, translation
from processes import until
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

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


class TestDynamic:
    @pytest.fixture
    def broadcaster(self, tf2_ros, node):
        return tf2_ros.TransformBroadcaster(node)

    @pytest.mark.parametrize("kind", [list, tuple, iter])
    def test_it_sends_one_or_any_iterable(self, broadcaster, subscribe, executor, kind):
        messages = subscribe("/tf")
        until(lambda: broadcaster.pub_tf.get_subscription_count() == 1, executor)
        broadcaster.sendTransform(transform("map", "robot", 1, (1, 2, 3)))
        broadcaster.sendTransform(kind([transform("map", "a", 1), transform("map", "b", 1)]))
        until(lambda: len(messages) == 2, executor)
        assert [children(message) for message in messages] == [["robot"], ["a", "b"]]
        assert translation(messages[0].transforms[0]) == (1, 2, 3)

    @pytest.mark.ours
    def test_its_quality_of_service_is_that_of_tf(self, broadcaster, node):
        qos = broadcaster.pub_tf.qos_profile
        assert (qos.depth, qos.durability) == (100, DurabilityPolicy.VOLATILE)
        assert qos.history == HistoryPolicy.KEEP_LAST

    def test_its_quality_of_service_may_be_chosen(self, tf2_ros, node):
        qos = QoSProfile(depth=4, reliability=ReliabilityPolicy.BEST_EFFORT)
        assert tf2_ros.TransformBroadcaster(node, qos).pub_tf.qos_profile.depth == 4
        assert tf2_ros.TransformBroadcaster(node, 4).pub_tf.topic_name == "/tf"

    @pytest.mark.ours
    def test_parameters_override_its_quality_of_service(self, tf2_ros, new_node):
        arguments = ["--ros-args", "-p", "qos_overrides./tf.publisher.depth:=6"]
        node = new_node("sending", cli_args=arguments)
        assert tf2_ros.TransformBroadcaster(node).pub_tf.qos_profile.depth == 6


class TestStatic:
    @pytest.fixture
    def broadcaster(self, tf2_ros, node):
        return tf2_ros.StaticTransformBroadcaster(node)

    def test_a_late_subscriber_gets_all_that_was_sent(self, broadcaster, subscribe, executor):
        broadcaster.sendTransform(transform("map", "a"))
        broadcaster.sendTransform([transform("map", "b"), transform("map", "c")])
        messages = subscribe("/tf_static")
        until(lambda: messages, executor)
        assert children(messages[-1]) == ["a", "b", "c"]

    def test_what_was_sent_is_in_net_message(self, broadcaster):
        broadcaster.sendTransform((transform("map", "a"), transform("map", "b")))
        assert children(broadcaster.net_message) == ["a", "b"]

    @pytest.mark.ours
    def test_threads_that_send_at_the_same_time_lose_nothing(self, broadcaster, subscribe, executor):
        names = [[f"{thread}_{i}" for i in range(100)] for thread in "abcd"]

        def send(own):
            for name in own:
                broadcaster.sendTransform(transform("map", name))

        threads = [threading.Thread(target=send, args=(own,)) for own in names]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        expected = sorted(sum(names, []))
        assert sorted(children(broadcaster.net_message)) == expected
        messages = subscribe("/tf_static")
        until(lambda: messages, executor)
        assert sorted(children(messages[-1])) == expected, "the message published last holds all"

    @pytest.mark.ours
    def test_a_child_sent_again_replaces_its_earlier_transform(self, broadcaster, subscribe, executor):
        broadcaster.sendTransform([transform("map", "a", 0, (1, 0, 0)), transform("map", "b")])
        broadcaster.sendTransform(transform("odom", "a", 0, (2, 0, 0)))
        assert children(broadcaster.net_message) == ["a", "b"]
        messages = subscribe("/tf_static")
        until(lambda: messages, executor)
        replaced = messages[-1].transforms[0]
        assert (replaced.header.frame_id, translation(replaced)) == ("odom", (2, 0, 0))

    @pytest.mark.ours
    def test_a_message_that_is_filled_in_again_changes_nothing_sent(self, broadcaster):
        message = transform("map", "a", 0, (1, 0, 0))
        broadcaster.sendTransform(message)
        message.child_frame_id = "b"
        message.transform.translation.x = 2.0
        broadcaster.sendTransform(message)
        sent = [(m.child_frame_id, m.transform.translation.x) for m in broadcaster.net_message.transforms]
        assert sent == [("a", 1.0), ("b", 2.0)]

    def test_its_quality_of_service_is_that_of_tf_static(self, broadcaster):
        qos = broadcaster.pub_tf.qos_profile
        assert (qos.depth, qos.durability) == (1, DurabilityPolicy.TRANSIENT_LOCAL)
        assert broadcaster.pub_tf.topic_name == "/tf_static"
