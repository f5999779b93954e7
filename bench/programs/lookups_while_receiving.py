# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Measure lookups while another process publishes the tree: the kind online of the evaluation of tf2_rs.

`lookups_while_receiving.py FRAMES` is that process: it publishes half of the frames once, as static, and the
others at 50 Hz.
"""

import itertools
import subprocess
import sys
import time
from time import perf_counter_ns

import numpy as np
import rclpy
from geometry_msgs.msg import TransformStamped
from load_publisher import DISCOVERY_S, run
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from tf2_ros_library import S, fill
from trees_and_queries import CACHE_S, bushy

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer, TransformListener

HOPS, PAIRS = (1, 4, 10), 100
PERIOD_S = 0.02
AGE_S, HISTORY_S = 0.5, 0.8  # of the times that are looked up; of what must have arrived before
BATCH, PAUSE_S = 25, 0.025  # 1,000 lookups a second


def tree_of(frames):
    return bushy(f"online {frames}", frames, 0.5, 2)


def online(rows, sizes, _):
    tree = tree_of(sizes.online_frames)
    publisher = subprocess.Popen([sys.executable, __file__, str(sizes.online_frames)])
    rclpy.init()
    buffer = Buffer(Duration(seconds=CACHE_S))
    listener = TransformListener(buffer, rclpy.create_node("bench_online"), spin_thread=True)
    try:
        _await_history(buffer, tree)
        for hops in HOPS:
            labels = {"tree": tree.name, "place": "past", "hops": hops}
            times, cpu = _look_up(buffer, tree, hops, sizes.warm_up, sizes.online_s)
            rows.add("buffer", labels, times)
            rows.add("p99", labels, [np.percentile(times, 99)])
            rows.add("CPU", labels, [cpu], "CPU")
    finally:
        publisher.terminate()
        publisher.wait()
    listener.unregister()
    rclpy.shutdown()


def _await_history(buffer, tree):
    deadline, moving = time.monotonic() + DISCOVERY_S, tree.names[tree.dynamic.index(True)]
    oldest = None
    while oldest is None or time.time_ns() - oldest < (AGE_S + HISTORY_S) * S:
        if time.monotonic() > deadline:
            raise RuntimeError("the tree did not arrive")
        time.sleep(PERIOD_S)
        if oldest is None and len(buffer._getFrameStrings()) == len(tree.names):
            oldest = time.time_ns()
    buffer.lookup_transform(tree.names[0], moving, Time())


def _look_up(buffer, tree, hops, warm_up, seconds):
    """ns of each lookup, and CPU seconds of the process per second."""
    pairs = itertools.cycle([(tree.names[a], tree.names[b]) for a, b in tree.pairs(hops, PAIRS)])
    for target, source in itertools.islice(pairs, warm_up):
        buffer.lookup_transform(target, source, _past())
    times, before_ns, end = [], time.process_time_ns(), time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(PAUSE_S)  # others use the caches meanwhile
        past = _past()
        for target, source in itertools.islice(pairs, BATCH):
            start = perf_counter_ns()
            buffer.lookup_transform(target, source, past)
            times.append(perf_counter_ns() - start)
    return times, (time.process_time_ns() - before_ns) / S / seconds


def _past():
    return Time(nanoseconds=time.time_ns() - int(AGE_S * S))


def publish(frames):
    node, messages = rclpy.create_node("bench_tree"), {True: {}, False: {}}
    for child, parent, static, _, pose in tree_of(frames).transforms():
        messages[static][child] = fill(TransformStamped(), child, parent, 0, pose)
    still, moving = (list(own.values()) for own in messages.values())
    lasting = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    latched = node.create_publisher(TFMessage, "/tf_static", lasting)
    latched.publish(TFMessage(transforms=still))
    publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
    due = time.monotonic()
    while rclpy.ok():
        now = divmod(time.time_ns(), S)
        for transform in moving:
            transform.header.stamp.sec, transform.header.stamp.nanosec = now
        publisher.publish(TFMessage(transforms=moving))
        due += PERIOD_S
        time.sleep(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    run(publish)
