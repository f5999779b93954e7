"""
Publishes messages faster than the middleware sends them, once there is a subscriber.

Arguments: the topic, and how many messages.

The queue of the publisher has room for one of them, so most are lost on the way. Ends when nobody subscribes.
"""

import os
import sys

os.environ["RMW_FASTRTPS_PUBLICATION_MODE"] = "ASYNCHRONOUS"  # another thread sends them

import rclpy
from geometry_msgs.msg import TransformStamped
from processes import until
from rclpy.serialization import serialize_message

from tf2_msgs.msg import TFMessage

MANY = 20_000  # transforms


def main(topic, messages):
    rclpy.init()
    publisher = rclpy.create_node("losing").create_publisher(TFMessage, topic, 1)
    until(lambda: publisher.get_subscription_count() > 0)
    message = serialize_message(TFMessage(transforms=[TransformStamped()] * MANY))
    for _ in range(messages):
        publisher.publish(message)
    until(lambda: publisher.get_subscription_count() == 0)
    rclpy.shutdown()


main(sys.argv[1], int(sys.argv[2]))
