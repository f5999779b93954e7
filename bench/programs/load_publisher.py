"""
A node that publishes on /tf as it is told, and the class that starts it.

`load_publisher.py messages LISTENERS [DEPTH]` publishes once so many subscribe. It takes lines of standard
input: RATE TRANSFORMS MESSAGES; and answers each, when it has published, with the seconds that this took.
`load_publisher.py tree FRAMES` publishes the static frames of a tree once, and its dynamic frames at 50 Hz.
"""

import signal
import subprocess
import sys
import threading
import time

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from serialized_template import Template
from tf2_python import S, fill
from trees_and_queries import bushy

from tf2_msgs.msg import TFMessage

START_NS, STEP_NS = 10**12, 20 * 10**6  # the stamp of message n follows from n, whatever the rate
TREE_PERIOD_S = 0.02
DEPTH = 100  # of a queue, where nothing else is wanted
DISCOVERY_S = 60


class Publisher:
    """The process. Message n has the stamp `stamp_ns(n)`, and as x the seconds of the steady clock then."""

    def __init__(self, *arguments):
        command = [sys.executable, __file__, *map(str, arguments)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._next = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.communicate()

    def start(self, rate, transforms, messages):
        """Have it publish so many messages of so many transforms; the number of the first one."""
        self.process.stdin.write(f"{rate} {transforms} {messages}\n")
        self.process.stdin.flush()
        self._next += messages
        return self._next - messages

    def finish(self):
        """Wait until they are published; the seconds that this has taken."""
        return float(self.process.stdout.readline())


def stamp_ns(number):
    return START_NS + number * STEP_NS


def online_tree(frames):
    return bushy(f"online {frames}", frames, 0.5, 2)


def publish(listeners, depth=DEPTH):
    node = rclpy.create_node("bench_publishing")
    publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=int(depth)))
    deadline = time.monotonic() + DISCOVERY_S
    while publisher.get_subscription_count() != int(listeners):
        if time.monotonic() > deadline:
            raise SystemExit(f"{publisher.get_subscription_count()} listen, not {listeners}")
        threading.Event().wait(0.01)
    number = 0
    for line in sys.stdin:
        rate, transforms, messages = map(int, line.split())
        template, began = Template(transforms), time.monotonic()
        for i in range(messages):
            early_s = began + i / rate - time.monotonic()
            if early_s > 0:
                time.sleep(early_s)
            publisher.publish(template.message(stamp_ns(number), time.monotonic()))
            number += 1
        print(time.monotonic() - began, flush=True)


def publish_tree(frames):
    node = rclpy.create_node("bench_publishing")
    messages = {True: {}, False: {}}
    for child, parent, static, _, pose in online_tree(int(frames)).transforms():
        messages[static][child] = fill(TransformStamped(), child, parent, 0, pose)
    still, moving = (list(own.values()) for own in messages.values())
    lasting = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(TFMessage, "/tf_static", lasting).publish(TFMessage(transforms=still))
    publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=DEPTH))
    due = time.monotonic()
    while True:
        now = divmod(time.time_ns(), S)
        for transform in moving:
            transform.header.stamp.sec, transform.header.stamp.nanosec = now
        publisher.publish(TFMessage(transforms=moving))
        due += TREE_PERIOD_S
        time.sleep(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    what, *arguments = sys.argv[1:]
    try:
        {"messages": publish, "tree": publish_tree}[what](*arguments)
    finally:
        rclpy.shutdown()
