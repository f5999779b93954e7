# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A node that publishes what its standard input orders, line by line, and answers "ok" when it has."""

import json
import sys
import threading
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from times_and_transforms import transform

from tf2_msgs.msg import TFMessage
from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

DEADLINE_S = 60.0


class Peer:
    def __init__(self, node):
        self.node = node
        self.dynamic = TransformBroadcaster(node)
        self.static = StaticTransformBroadcaster(node)
        self.publishers = {}

    def wait_for_subscribers(self, publisher, count=1):
        deadline = time.monotonic() + DEADLINE_S
        while publisher.get_subscription_count() < count:
            if time.monotonic() > deadline:
                raise TimeoutError(f"too few subscribers of {publisher.topic_name}")
            threading.Event().wait(0.005)

    def publisher(self, kind, topic, subscribed=True):
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(kind, topic, 100)
        if subscribed:
            self.wait_for_subscribers(self.publishers[topic])
        return self.publishers[topic]

    def do_send(self, transforms, static, subscribed=True):
        broadcaster = self.static if static else self.dynamic
        if subscribed:
            self.wait_for_subscribers(broadcaster.pub_tf)
        made = [transform(parent, child, xyz=(x, 0, 0), ns=ns) for parent, child, ns, x in transforms]
        broadcaster.sendTransform(made)

    def do_matched(self, count):
        self.wait_for_subscribers(self.dynamic.pub_tf, count)

    def do_bytes(self, topic, hex):
        self.publisher(TFMessage, topic).publish(bytes.fromhex(hex))

    def do_text(self, topic):
        self.publisher(String, topic, subscribed=False).publish(String(data="no transform"))

    def do_clock(self, seconds, subscribed):
        message = Clock()
        message.clock.sec = seconds
        # Only the first has to arrive: it may be what the subscriber ends at.
        publisher = self.publishers.get("/clock") or self.publisher(Clock, "/clock", subscribed)
        publisher.publish(message)


def main():
    rclpy.init(args=sys.argv)
    node = rclpy.create_node("peer")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin)
    spinning.start()
    peer = Peer(node)
    try:
        for line in sys.stdin:
            order = json.loads(line)
            getattr(peer, "do_" + order.pop("do"))(**order)
            print("ok", flush=True)
    finally:
        # Not the context first: that would be an exception in the thread.
        executor.create_task(executor.shutdown)
        spinning.join()
        rclpy.shutdown()


if __name__ == "__main__":
    main()
