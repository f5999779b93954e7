# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
A node that publishes on /tf as it is told, and the class that starts it.

`load_publisher.py LISTENERS` publishes once so many subscribe. It takes lines of standard input:
RATE TRANSFORMS MESSAGES; and answers each when it has published.
"""

import signal
import subprocess
import sys
import threading
import time

import rclpy
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from serialized_template import Template

from tf2_msgs.msg import TFMessage

START_NS, STEP_NS = 10**12, 20 * 10**6  # the stamp of message n follows from n, whatever the rate
DEPTH = 100  # of the queue
DISCOVERY_S = 60


class Publisher:
    """The process. Message n has the stamp `stamp_ns(n)`, and as x the seconds of the steady clock then."""

    def __init__(self, listeners):
        command = [sys.executable, __file__, str(listeners)]
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
        """Wait until they are published."""
        if not self.process.stdout.readline():
            raise RuntimeError("the publisher has ended")


def stamp_ns(number):
    return START_NS + number * STEP_NS


def publish(listeners):
    node = rclpy.create_node("bench_publishing")
    publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=DEPTH))
    deadline = time.monotonic() + DISCOVERY_S
    while publisher.get_subscription_count() != listeners:
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
        print("published", flush=True)


def run(publish):
    """Publish, with the number in the command line, until the process is terminated."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    try:
        publish(int(sys.argv[1]))
    finally:
        rclpy.shutdown()


if __name__ == "__main__":
    run(publish)
