# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Publishes serialized messages of many transforms on /tf at a steady rate, once there is a subscriber.

Message n carries the stamp START_NS + n periods and x = n; its frames are map and f0, f1, ... Arguments:
messages per second, transforms in each, how many messages (0: without end).
"""

import sys
import threading
import time

import rclpy
from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import QoSProfile

from bench.programs.serialized_template import NS_PER_S, Template
from tf2_msgs.msg import TFMessage

START_NS = 10**12
DEPTH = 2000


def main(rate, count, messages):
    rclpy.init()
    node = rclpy.create_node("flooding")
    publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=DEPTH))
    template = Template(count)
    while rclpy.ok() and publisher.get_subscription_count() == 0:
        threading.Event().wait(0.005)
    due = time.monotonic()
    n = 0
    while rclpy.ok() and (n < messages or not messages):
        early_s = due - time.monotonic()
        if early_s > 0:
            time.sleep(early_s)  # the rate is what this program is about
        else:
            due -= early_s  # what is late is not made up for by a burst
        try:
            publisher.publish(template.message(START_NS + n * NS_PER_S // rate, n))
        except (InvalidHandle, rclpy_implementation.RCLError):
            break  # the context was shut down
        n += 1
        due += 1 / rate
    if rclpy.ok():
        publisher.wait_for_all_acked()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
