# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of feeds share: a message, what a feed has received, and a wire of the test."""

import numpy as np
from times_and_transforms import S, translation

from tf2_ros.serialization import serialize_arrays
from tf2_ros_tools.live import Publisher


def message(parent="map", child="base", x=1.0, seconds=1.0, count=1):
    """A serialized TFMessage."""
    frames = [(parent, child if n == 0 else f"{child}{n}") for n in range(count)]
    numbers = np.tile([x, 0, 0, 0, 0, 0, 1], (count, 1))
    return serialize_arrays(frames, np.full(count, round(seconds * S)), numbers)


def seen(feed, parent="map", child="base"):
    return translation(feed.buffer.lookup_transform(parent, child, 0))[0]


class Wire:
    """A wire that notes what it is asked for."""

    counts_losses = True

    def __init__(self, refusal=None, reasons=None):
        self.refusal, self.reasons = refusal, reasons or {}
        self.take = self.end = None
        self.closed = 0
        self.sent = []

    def open(self, take, end):
        if self.refusal is not None:
            raise self.refusal
        self.take, self.end = take, end

    def close(self):
        self.closed += 1

    def publishers(self):
        return [Publisher("/tf", "/robot", "")]

    def why_silent(self, topic, seconds):
        return self.reasons.get(topic, "")

    def sender(self, topic, is_static):
        return Sender(self, topic)


class Sender:
    def __init__(self, wire, topic):
        self.wire, self.topic = wire, topic

    def send(self, data):
        self.wire.sent.append((self.topic, data))
