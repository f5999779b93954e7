"""
Publishes messages of many transforms on /tf at a steady rate, serialised beforehand, once somebody listens.

Message n carries the stamp START_NS + n periods and x = n; its frames are map and f0, f1, ... Arguments:
messages per second, transforms in each, how many messages (0: without end). Says how many seconds it took.
"""

import sys
import threading
import time

import numpy as np
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message

from tf2_msgs.msg import TFMessage

START_NS = 10**12
NS_PER_S = 10**9
DEPTH = 2000
MARK = (0x12345678, 0x2468ACE0, 1.5e-300)  # stamp and x of every transform of the template


class Template:
    """A serialised message, and where in it the stamps and the translations are."""

    def __init__(self, count):
        transforms = []
        for i in range(count):
            transform = TransformStamped()
            transform.header.frame_id, transform.child_frame_id = "map", f"f{i}"
            transform.header.stamp.sec, transform.header.stamp.nanosec = MARK[:2]
            transform.transform.translation.x = MARK[2]
            transforms.append(transform)
        self._bytes = np.frombuffer(serialize_message(TFMessage(transforms=transforms)), np.uint8).copy()
        self._stamps = self._places(np.array(MARK[:2], "<u4"), count)
        self._translations = self._places(np.array(MARK[2:], "<f8"), count)

    def _places(self, mark, count):
        mark, data, places = mark.tobytes(), self._bytes.tobytes(), []
        while (place := data.find(mark, places[-1] + 1 if places else 0)) >= 0:
            places.append(place)
        assert len(places) == count
        return np.array(places)[:, None] + np.arange(8)

    def message(self, ns, x):
        self._bytes[self._stamps] = np.array(divmod(ns, NS_PER_S), "<u4").view(np.uint8)
        self._bytes[self._translations] = np.array([x], "<f8").view(np.uint8)
        return self._bytes.tobytes()


def main(rate, count, messages):
    rclpy.init()
    node = rclpy.create_node("flooding")
    publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=DEPTH))
    template = Template(count)
    while publisher.get_subscription_count() == 0:
        threading.Event().wait(0.005)
    began = time.monotonic()
    n = 0
    while n < messages or not messages:
        early_s = began + n / rate - time.monotonic()
        if early_s > 0:
            time.sleep(early_s)  # the rate is what this program is about
        publisher.publish(template.message(START_NS + n * NS_PER_S // rate, n))
        n += 1
    print(time.monotonic() - began, flush=True)
    publisher.wait_for_all_acked()
    rclpy.shutdown()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
