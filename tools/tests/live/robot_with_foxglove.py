# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A robot with foxglove_bridge in the tests of `tf2_ros_tools.live`: foxglove-sdk, a part of the bridge."""

import threading
import time

import foxglove
from foxglove import Channel, Schema

S = 10**9
SCHEMA = "tf2_msgs/msg/TFMessage"

_retained = {}  # the last message of a latched topic, which a client gets when it subscribes
channels = {}  # by topic


class Listener:
    def on_subscribe(self, client, channel):
        offered = channels.get(channel.topic)  # None: `offer` has not returned yet
        if offered in _retained:
            offered.log(_retained[offered])

    def on_unsubscribe(self, client, channel):
        pass


def start(port):
    global server
    server = foxglove.start_server(port=port, server_listener=Listener())


def offer(topic, schema=SCHEMA, encoding="cdr"):
    described = Schema(name=schema, encoding="ros2msg", data=b"")
    channels[topic] = Channel(topic, schema=described, message_encoding=encoding)


def has_client(topic):
    """Whether a client has subscribed within some seconds."""
    until_s = time.monotonic() + 5
    while not channels[topic].has_sinks() and time.monotonic() < until_s:
        time.sleep(0.01)
    return channels[topic].has_sinks()


def send(topic, text, count=1, rate=0.0, latches=False):
    """Send a message, in hexadecimal digits; `count` times, with `rate` messages per second."""
    channel, data = channels[topic], bytes.fromhex(text)
    if latches:
        _retained[channel] = data

    def run():
        due = time.monotonic()
        for _ in range(count):
            channel.log(data)
            due += 1 / rate if rate else 0.0
            time.sleep(max(0.0, due - time.monotonic()))

    if count == 1:
        run()
    else:
        threading.Thread(target=run, daemon=True).start()
