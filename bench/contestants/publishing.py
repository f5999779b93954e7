"""`publishing.py [DEPTH]`: a node that publishes on order a tree's frames, or transforms at a rate."""

import sys
import threading
import time

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros2_tf2 import DISCOVERY_S, S, fill
from serialised import Template
from serving import Tree, serve

from tf2_msgs.msg import TFMessage

START_NS = 10**12
STEP_NS = 20 * 10**6  # from message to message, whatever the rate
TREE_PERIOD_S = 0.02
DEPTH = 100  # of the queue, where nothing else is wanted


class Sending:
    """
    Sends messages at a rate, in a thread.

    Message n carries the stamp `start_ns` + n * `step_ns` and, as x, the seconds of the steady clock then.

    :param send: is called with the bytes of each.
    """

    start_ns, step_ns = START_NS, STEP_NS
    links = None  # (parent, child) of the transforms; see Template

    def __init__(self, send):
        super().__init__()
        self._send = send
        self._thread = None
        self._next = 0
        self._seconds = 0.0
        self._ending = threading.Event()

    def order_start(self, rate, transforms, messages):
        """Begin to send so many messages; `next` is the number of the first."""
        first, template = self._next, Template(transforms, self.links and self.links[:transforms])
        self._next += messages
        self._ending.clear()
        self._thread = threading.Thread(target=self._send_all, args=(rate, template, first, self._next))
        self._thread.start()
        return {"next": first}

    def order_finish(self):
        """Wait until they are sent; the seconds that this has taken since the start."""
        self._thread.join()
        return {"seconds": self._seconds}

    def order_break_off(self):
        """Send no more of them."""
        self._ending.set()
        return self.order_finish()

    def end(self):
        self._ending.set()
        if self._thread is not None:
            self._thread.join()

    def _send_all(self, rate, template, first, end):
        began = time.monotonic()
        for n in range(first, end):
            early_s = began + (n - first) / rate - time.monotonic()
            if early_s > 0:
                time.sleep(early_s)
            if self._ending.is_set():
                break
            self._send(template.message(self.start_ns + n * self.step_ns, time.monotonic()))
        self._seconds = time.monotonic() - began


class Publishing(Sending):
    def __init__(self, depth=DEPTH):
        rclpy.init()
        self._node = rclpy.create_node("bench_publishing")
        self._publisher = self._node.create_publisher(TFMessage, "/tf", QoSProfile(depth=int(depth)))
        super().__init__(self._publisher.publish)

    def end(self):
        super().end()
        rclpy.shutdown()

    def order_discover(self, listeners):
        deadline = time.monotonic() + DISCOVERY_S
        while self._publisher.get_subscription_count() != listeners:
            if time.monotonic() > deadline:
                return {"error": f"{self._publisher.get_subscription_count()} listen, not {listeners}"}
            threading.Event().wait(0.01)
        return {"next": self._next}

    def order_tree(self, path):
        """Publish a tree's static frames once, and its dynamic frames at 50 Hz until the end."""
        frames = {child: (static, parent, pose) for child, parent, static, _, pose in Tree(path).records()}
        still, moving = (
            [
                fill(TransformStamped(), child, parent, 0, pose)
                for child, (static, parent, pose) in frames.items()
                if static == wanted
            ]
            for wanted in (True, False)
        )
        lasting = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._node.create_publisher(TFMessage, "/tf_static", lasting).publish(TFMessage(transforms=still))
        self._thread = threading.Thread(target=self._publish_moving, args=(moving,))
        self._thread.start()
        return {}

    def _publish_moving(self, moving):
        due = time.monotonic()
        while not self._ending.is_set():
            now = divmod(time.time_ns(), S)
            for transform in moving:
                transform.header.stamp.sec, transform.header.stamp.nanosec = now
            self._publisher.publish(TFMessage(transforms=moving))
            due += TREE_PERIOD_S
            self._ending.wait(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    publishing = Publishing(*sys.argv[1:])
    serve(publishing, publishing.end)
