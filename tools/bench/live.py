# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure feeds of a robot without ROS 2, beside a listener of rclpy."""

import time

import numpy as np
from load_publisher import Publisher
from receiving import LOADS, WAKE_RATE, Listening, look

from tf2_ros_tools.live import connect

DISCOVERY_S = 10  # until both sides know of each other


class Feeding(Listening):
    """A feed, with a buffer, that can be measured as a listener."""

    def __init__(self, where):
        self._feed = connect(where)
        self.buffer = self._feed.buffer

    def __exit__(self, *_):
        self._feed.close()


def receiver(variant):
    return Listening() if variant == "listener" else Feeding(variant)


def cpu(rows, sizes, _, variant):
    """CPU of a process per message that it receives while nothing waits."""
    transforms, rate = LOADS[0]
    with receiver(variant) as receiving, Publisher(1) as publisher:
        receiving.receive(publisher, rate, transforms, sizes.filling)
        messages = round(rate * sizes.receive_s)
        before_ns = time.process_time_ns()
        receiving.receive(publisher, rate, transforms, messages)
        each_ns = (time.process_time_ns() - before_ns) / messages
    labels = {"transforms": transforms, "Hz": rate}
    rows.add(variant, labels, [each_ns])


def waits(rows, sizes, _, variant):
    """How soon a waiting lookup returns: from sending in another process."""
    with receiver(variant) as receiving, Publisher(1) as publisher:
        receiving.receive(publisher, WAKE_RATE, 1, DISCOVERY_S * WAKE_RATE)
        first = publisher.start(WAKE_RATE, 1, sizes.wakes)
        times = look(receiving.buffer, range(first, first + sizes.wakes))
        publisher.finish()
    rows.add(variant, {"Hz": WAKE_RATE}, times)
    rows.add(f"{variant}, p99", {"Hz": WAKE_RATE}, [np.percentile(times, 99)])
