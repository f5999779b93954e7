# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Publish to a stress run from another process, until the standard input ends; then print how much."""

import json
import sys
import threading
import time

import rclpy
from rclpy.qos import QoSProfile

from reliability.stress_truth import SENT, START_NS, STEP_NS, sample
from tf2_msgs.msg import TFMessage

RATE = 100  # messages a second


def main():
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    rclpy.init()
    node = rclpy.create_node("stress_publisher")
    publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
    began, number = time.monotonic(), 0
    while not ended.wait(max(0.0, began + number / RATE - time.monotonic())):
        time_ns = START_NS + number * STEP_NS
        publisher.publish(TFMessage(transforms=[sample(frame, time_ns) for frame in SENT]))
        number += 1
    node.destroy_node()
    rclpy.try_shutdown()
    print(json.dumps({"messages": number}), flush=True)


if __name__ == "__main__":
    main()
