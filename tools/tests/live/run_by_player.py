# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a player of recordings does in the tests, in place of `ros2 bag play`: with rclpy and mcap."""

from importlib import import_module

import rclpy
import yaml
from mcap.reader import make_reader
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from waiting import DEADLINE_S


class Player:
    """
    Publishes the messages of an .mcap in the order of their log times, each topic with its recorded QoS.

    It does not wait for the log times, but for each message until all reliable subscribers have received it.
    """

    def __init__(self, path):
        rclpy.init(args=[])
        self._node = rclpy.create_node("player")
        with open(path, "rb") as file:
            found = [*make_reader(file).iter_messages()]
        self._messages = [(one.topic, message.data) for _, one, message in found]
        self._publishers = {one.topic: self._publisher(schema, one) for schema, one, _ in found}

    def _publisher(self, schema, channel):
        package, _, name = schema.name.split("/")
        [qos] = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        return self._node.create_publisher(
            getattr(import_module(f"{package}.msg"), name),
            channel.topic,
            QoSProfile(
                history=HistoryPolicy.get_from_short_key(qos["history"]),
                depth=qos["depth"],
                reliability=ReliabilityPolicy.get_from_short_key(qos["reliability"]),
                durability=DurabilityPolicy.get_from_short_key(qos["durability"]),
            ),
        )

    def topics_without_subscriber(self):
        return [topic for topic, one in self._publishers.items() if not one.get_subscription_count()]

    def play(self):
        for topic, data in self._messages:
            publisher = self._publishers[topic]
            publisher.publish(data)
            assert publisher.wait_for_all_acked(Duration(seconds=DEADLINE_S)), topic
