# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a robot does in the tests of `tf2_ros_tools.live`, with rclpy alone, of any ROS 2."""

import threading
import time

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock

from tf2_msgs.msg import TFMessage

S = 10**9
LATCHED = DurabilityPolicy.TRANSIENT_LOCAL

heard = {}  # transforms that were received, by topic and child frame
messages = {"/tf": 0, "/tf_static": 0}
_kept = []


def start():
    rclpy.init(args=[])
    global _executor
    _executor = SingleThreadedExecutor()
    threading.Thread(target=_executor.spin, daemon=True).start()


def node(name):
    made = rclpy.create_node(name)
    _executor.add_node(made)
    return made


def made(parent, child, x=0.0, ns=None):
    m = TransformStamped(child_frame_id=child)
    m.header.frame_id = parent
    m.header.stamp.sec, m.header.stamp.nanosec = divmod(time.time_ns() if ns is None else ns, S)
    m.transform.translation.x = float(x)
    return m


def latched(name, *transforms, topic="/tf_static"):
    """A node that sends static transforms, each as the arguments of `made`."""
    publisher = node(name).create_publisher(TFMessage, topic, QoSProfile(depth=1, durability=LATCHED))
    publisher.publish(TFMessage(transforms=[made(*one) for one in transforms]))
    _kept.append(publisher)


def publisher(name, topic="/tf", depth=100, reliable=True, latches=False):
    """A publisher of a new node."""
    qos = QoSProfile(depth=depth)
    if not reliable:
        qos.reliability = ReliabilityPolicy.BEST_EFFORT
    if latches:
        qos.durability = LATCHED
    one = node(name).create_publisher(TFMessage, topic, qos)
    _kept.append(one)
    return one


def matched(publisher, count=1):
    """Whether it has as many subscribers."""
    return publisher.get_subscription_count() >= count


def send(publisher, *transforms):
    publisher.publish(TFMessage(transforms=[made(*one) for one in transforms]))


def send_bytes(publisher, text):
    publisher.publish(bytes.fromhex(text))


def clock(name="clock"):
    publisher = node(name).create_publisher(Clock, "/clock", 10)
    _kept.append(publisher)


def flood(publisher, rate, count, messages):
    """
    Publish serialized messages of many transforms at a steady rate, in a thread.

    Message n has x = n. The stamp of each is the present.
    """
    mark_x, mark_stamp = 1.5e-300, 0x12345678 * S + 0x2468ACE0
    import numpy as np

    many = [made("map", f"f{i}", mark_x, mark_stamp) for i in range(count)]
    data = np.frombuffer(bytes(serialize_message(TFMessage(transforms=many))), np.uint8).copy()

    def places(mark):
        raw, found, at = data.tobytes(), [], -1
        while (at := raw.find(mark, at + 1)) >= 0:
            found.append(at)
        assert len(found) == count
        return np.array(found)[:, None] + np.arange(len(mark))

    stamps = places(np.array(divmod(mark_stamp, S), "<u4").tobytes())
    xs = places(np.array([mark_x], "<f8").tobytes())

    def run():
        due = time.monotonic()
        for n in range(messages):
            early_s = due - time.monotonic()
            if early_s > 0:
                time.sleep(early_s)
            data[stamps] = np.array(divmod(time.time_ns(), S), "<u4").view(np.uint8)
            data[xs] = np.array([n], "<f8").view(np.uint8)
            try:
                publisher.publish(data.tobytes())
            except rclpy_implementation.RCLError:
                return
            due += 1 / rate

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread


def listen(name="listener"):
    """A node that notes in `heard` and `messages` what it receives."""
    one = node(name)

    def subscribe(topic, qos):
        def note(message):
            messages[topic] += 1
            for transform in message.transforms:
                heard[topic, transform.child_frame_id] = transform.transform.translation.x

        _kept.append(one.create_subscription(TFMessage, topic, note, qos))

    subscribe("/tf", QoSProfile(depth=1000))
    subscribe("/tf_static", QoSProfile(depth=100, durability=LATCHED))
