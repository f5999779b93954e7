# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages that do not reach a buffer are counted in a warning."""

import gc

import pytest
from interposed_libraries import output_with_library
from processes import end, start
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rclpy.utilities import get_rmw_implementation_identifier
from waiting import errors_so_far, until

from tf2_msgs.msg import TFMessage

DEPTH, SENT = 2, 10
WITH_CYCLONEDDS = get_rmw_implementation_identifier() == "rmw_cyclonedds_cpp"


@pytest.fixture
def publisher(new_node):
    return new_node("sending").create_publisher(TFMessage, "/tf", SENT)


@pytest.fixture
def topic(tf2_ros, buffer, node):
    """The topic /tf of a listener with a short queue."""
    with tf2_ros.TransformListener(buffer, node, qos=DEPTH) as listener:
        yield listener._tf2_state.topics[0]


def publish(publisher, count):
    """Send messages without transforms to the listener."""
    until(lambda: publisher.get_subscription_count() == 1)
    for _ in range(count):
        publisher.publish(serialize_message(TFMessage()))


def send(publisher, count):
    """Publish, and wait until the middleware of the listener has the messages."""
    publish(publisher, count)
    assert publisher.wait_for_all_acked()


@pytest.fixture
def paused(tf2_ros, buffer, node):
    """A listener with a short queue whose messages nobody takes, and what ends that."""
    with tf2_ros.TransformListener(buffer, node, qos=DEPTH) as listener:
        inbox = listener._tf2_state.receiver.inbox
        inbox.fill(None)
        yield listener, lambda: inbox.fill(buffer)


class TestInTheQueueOfTheListener:
    def test_what_newer_messages_displace_is_counted_and_one_warning_says_so(self, paused, publisher, capfd):
        listener, go_on = paused
        topic = listener._tf2_state.topics[0]
        send(publisher, SENT)
        go_on()
        until(lambda: topic.lost() == (0, SENT - DEPTH))
        assert topic.arrivals.taken()[0] == DEPTH
        assert f"of /tf: {DEPTH} messages, last " in repr(listener)
        assert f" s ago, {SENT - DEPTH} lost; /tf_static" in repr(listener)
        warning = (
            "Lost 8 messages on /tf: newer ones displaced them in the queue, whose depth is 2. "
            "Give the listener a deeper queue, for example qos=100"
        )
        until(lambda: warning in errors_so_far())

    def test_the_next_warning_comes_later_and_names_the_rest(self, paused, publisher, capfd, monkeypatch):
        listener, go_on = paused
        topic = listener._tf2_state.topics[0]
        send(publisher, SENT)
        go_on()
        until(lambda: "Lost 8 messages" in errors_so_far())
        monkeypatch.setattr("tf2_ros._receive.listener_topics.LOSS_WARNING_S", 10**6)
        listener._tf2_state.receiver.inbox.fill(None)
        send(publisher, DEPTH + 1)
        go_on()
        until(lambda: topic.lost() == (0, SENT - DEPTH + 1))
        topic._tf2_check()
        assert "Lost 1 message " not in errors_so_far()
        monkeypatch.setattr("tf2_ros._receive.listener_topics.LOSS_WARNING_S", 0)
        until(lambda: "Lost 1 message on /tf" in errors_so_far())

    def test_messages_that_are_taken_in_time_are_not_lost(self, topic, publisher, buffer):
        for number in range(SENT):
            publish(publisher, DEPTH)
            until(lambda number=number: topic.arrivals.taken()[0] == (number + 1) * DEPTH)
        assert topic.lost() == (0, 0)

    def test_a_queue_that_keeps_all_loses_nothing(self, tf2_ros, buffer, node, publisher):
        """The depth of such a profile is a default that the middleware ignores."""
        keeps_all = QoSProfile(history=HistoryPolicy.KEEP_ALL)
        sent = 2 * max(keeps_all.depth, SENT)
        with tf2_ros.TransformListener(buffer, node, qos=keeps_all) as listener:
            inbox, topic = listener._tf2_state.receiver.inbox, listener._tf2_state.topics[0]
            inbox.fill(None)
            send(publisher, sent)
            inbox.fill(buffer)
            until(lambda: topic.arrivals.taken()[0] == sent)
            assert topic.lost() == (0, 0)

    @pytest.mark.skipif(WITH_CYCLONEDDS, reason="Cyclone DDS also announces ends of publishers")
    def test_a_queue_that_was_full_and_publishers_that_end_lose_nothing(self, paused, new_node):
        listener, go_on = paused
        topic = listener._tf2_state.topics[0]
        node = new_node("sending")
        for number in range(3):
            publisher = node.create_publisher(TFMessage, "/tf", SENT)
            send(publisher, DEPTH)
            node.destroy_publisher(publisher)
            until(lambda: listener.node.count_publishers("/tf") == 0)
            go_on()
            until(lambda number=number: topic.arrivals.taken()[0] == (number + 1) * DEPTH)
            listener._tf2_state.receiver.inbox.fill(None)
        assert topic.lost() == (0, 0)


@pytest.fixture
def losing():
    process = start("publishes_in_bursts.py", "/tf", "50")
    yield process
    end(process)


@pytest.mark.skipif(WITH_CYCLONEDDS, reason="Cyclone DDS reports none of these losses")
class TestOnTheWay:
    def test_what_the_middleware_reports_is_counted(
        self, inserter, tf2_ros, buffer, node, executor, losing, capfd
    ):
        with tf2_ros.TransformListener(buffer, node) as listener:
            until(lambda: listener._tf2_state.topics[0].lost()[0] > 0, executor)
            warning = " on /tf: they did not reach the listener. Make the listener and publishers reliable"
            until(lambda: warning in errors_so_far(), executor)
            assert "lost; /tf_static" in repr(listener)

    def test_what_a_latched_topic_replaces_is_not_lost(self, tf2_ros, buffer, node, losing):
        """As for one that subscribes late to static transforms which are sent again and again."""
        with (
            tf2_ros.TransformListener(buffer, node) as listener,
            tf2_ros.StaticTransformListener(tf2_ros.Buffer(), node, tf_static_topic="/tf") as latched,
        ):
            topics = listener._tf2_state.topics[0], latched._tf2_state.topics[0]
            until(lambda: topics[0].lost()[0] > 0 and topics[1].arrivals.taken()[0] > 0)
            assert topics[1].lost() == (0, 0)

    def test_the_count_survives_the_subscription(self, tf2_ros, buffer, node, losing):
        listener = tf2_ros.TransformListener(buffer, node)
        topic = listener._tf2_state.topics[0]
        lost = until(lambda: topic.lost()[0])
        listener.unregister()
        gc.collect()
        assert topic.lost()[0] >= lost


def test_a_middleware_without_the_event_loses_nothing_else(tmp_path):
    """The program listens as ever, and logs nothing about it."""
    printed = output_with_library(
        "faulty_middleware", tmp_path, program="receives_one_message", TF2_TEST_MIDDLEWARE="no_loss_events"
    )
    assert printed == "lost: (0, 0)\n"
