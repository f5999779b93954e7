# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Overflows the queue of a listener, and then takes each message before the next one is sent."""

import rclpy
from rclpy.serialization import serialize_message
from waiting import until

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer, TransformListener

DEPTH, SENT = 2, 10

rclpy.init()
node, buffer = rclpy.create_node("hearing"), Buffer()
publisher = rclpy.create_node("sending").create_publisher(TFMessage, "/tf", SENT)


def send(count):
    """Send messages without transforms."""
    for _ in range(count):
        publisher.publish(serialize_message(TFMessage()))
    assert publisher.wait_for_all_acked()


with TransformListener(buffer, node, qos=DEPTH) as listener:
    inbox, topic = listener._tf2_state.receiver.inbox, listener._tf2_state.topics[0]
    inbox.fill(None)  # so that all of them wait
    until(lambda: publisher.get_subscription_count() == 1)
    send(SENT)
    inbox.fill(buffer)
    until(lambda: topic.arrivals.taken()[0] == DEPTH)
    for number in range(4):
        send(1)
        until(lambda number=number: topic.arrivals.taken()[0] == DEPTH + number + 1)
        if number == 0:
            _, lost = topic.lost()  # what belongs to the overflow is reported by now
    print(f"taken: {topic.arrivals.taken()[0]}, lost since the overflow: {topic.lost()[1] - lost}")
rclpy.shutdown()
