"""A node that publishes transforms at a stated rate, serialised beforehand, when it is told to."""

import threading
import time

import rclpy
from rclpy.qos import QoSProfile
from serialised import Template
from serving import serve

from tf2_msgs.msg import TFMessage

START_NS = 10**12
STEP_NS = 20 * 10**6  # from message to message, whatever the rate
DISCOVERY_S = 20


class Flooding:
    """Message n carries the stamp START_NS + n * STEP_NS and, as x, the seconds of the steady clock then."""

    def __init__(self):
        rclpy.init()
        self._node = rclpy.create_node("bench_flooding")
        self._publisher = self._node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
        self._thread = None
        self._next = 0

    def order_discover(self, listeners):
        deadline = time.monotonic() + DISCOVERY_S
        while self._publisher.get_subscription_count() != int(listeners):
            if time.monotonic() > deadline:
                return {"error": f"{self._publisher.get_subscription_count()} listen, not {listeners}"}
            threading.Event().wait(0.01)
        return {"next": self._next}

    def order_start(self, rate, transforms, messages):
        """Begin to publish so many messages; `next` is the number of the first."""
        first, template = self._next, Template(int(transforms))
        self._next += int(messages)
        self._thread = threading.Thread(target=self._publish, args=(int(rate), template, first, self._next))
        self._thread.start()
        return {"next": first}

    def order_finish(self):
        """Wait until they are out."""
        self._thread.join()
        return {}

    def _publish(self, rate, template, first, end):
        began = time.monotonic()
        for n in range(first, end):
            early_s = began + (n - first) / rate - time.monotonic()
            if early_s > 0:
                time.sleep(early_s)
            self._publisher.publish(template.message(START_NS + n * STEP_NS, time.monotonic()))


if __name__ == "__main__":
    serve(Flooding())
