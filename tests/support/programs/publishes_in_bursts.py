# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Publishes messages in bursts, faster than the middleware sends them, while there is a subscriber.

Arguments: the topic, and how many messages are in a burst.

The queue of the publisher has room for one of them, so most are lost on the way. It is latched, so one that
subscribes later gets the last message. Ends when nobody subscribes.
"""

import os
import sys
import threading
from contextlib import suppress

os.environ["RMW_FASTRTPS_PUBLICATION_MODE"] = "ASYNCHRONOUS"  # another thread sends them

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy._rclpy_pybind11 import RCLError
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from waiting import until

from tf2_msgs.msg import TFMessage

MANY = 20_000  # transforms
PAUSE_S = 0.5  # between bursts, in which the subscriber works them off


def main(topic, messages):
    rclpy.init()
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = rclpy.create_node("losing").create_publisher(TFMessage, topic, latched)
    until(lambda: publisher.get_subscription_count() > 0)
    message = serialize_message(TFMessage(transforms=[TransformStamped()] * MANY))
    pause = threading.Event()
    # The subscriber may not have found this publisher when the first burst is sent.
    while publisher.get_subscription_count() > 0:
        for _ in range(messages):
            with suppress(RCLError):  # on a busy machine, the queue is still full after 100 ms: one more lost
                publisher.publish(message)
        pause.wait(PAUSE_S)
    rclpy.shutdown()


main(sys.argv[1], int(sys.argv[2]))
