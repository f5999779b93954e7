# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a laptop does in the tests of `tf2_ros_tools.live`; `without_rclpy.py` has taken rclpy from it."""

import ctypes
import threading
import time

from tf2_ros import TransformStamped
from tf2_ros_tools.live import connect


def made(parent, child, x):
    m = TransformStamped(child_frame_id=child)
    m.header.frame_id, m.transform.translation.x, m.transform.rotation.w = parent, float(x), 1.0
    return m


def seen(feed, parent, child):
    return feed.buffer.lookup_transform(parent, child, 0).transform.translation.x


def heard(feed):
    """Of /tf and /tf_static: how many messages were received, lost and malformed."""
    return [(one.count, one.lost, one.malformed) for one in feed.topics.values()]


def hold_gil(seconds):
    ctypes.PyDLL(None).usleep(int(seconds * 1e6))


def wait_for_each_hundredth(feed, messages, timeout):
    """Wait in lookups while messages of `robot_with_rclpy.flood` arrive."""
    for n in range(0, messages, 100):
        while feed.topics["/tf"].count + (feed.topics["/tf"].lost or 0) <= n:
            time.sleep(0.001)
        feed.buffer.lookup_transform("map", "f49", 0, timeout=timeout)


def close_while_messages_arrive(where, closer, timeout):
    """Connect to what sends f49 all the time, and close the feed; `closer`: a thread, several, a callback."""
    feed = connect(where)
    if closer == "a callback":
        closed = threading.Event()
        feed.buffer.on_change("map", "f49", lambda *_: (feed.close(), closed.set()))
        assert closed.wait(timeout)
    else:
        feed.buffer.lookup_transform("map", "f49", 0, timeout=timeout)
        closers = [threading.Thread(target=feed.close) for _ in range(3 if closer == "several" else 1)]
        for one in closers:
            one.start()
        for one in closers:
            one.join()
    count = feed.topics["/tf"].count
    time.sleep(0.01)
    assert feed.topics["/tf"].count == count
    feed.close()
