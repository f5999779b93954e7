# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Insert transforms while a buffer without a node waits; needs no ROS."""

import threading
import time

import tf2_ros

DEADLINE_S = 60.0
S = 10**9


def transform(parent, child, ns=0, x=0.0):
    made = tf2_ros.TransformStamped(child_frame_id=child)
    made.header.frame_id = parent
    made.header.stamp.sec, made.header.stamp.nanosec = divmod(ns, S)
    made.transform.translation.x = float(x)
    return made


def insert(buffer, ns, x=0.0):
    buffer.set_transform(transform("map", "base", ns, x), "test")


def until(condition):
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.001)


def once_waiting(buffer, call):
    """Call in a thread, once a wait is pending."""

    def run():
        until(lambda: buffer.statistics()["waiters"])
        call()

    thread = threading.Thread(target=run)
    thread.start()
    return thread
