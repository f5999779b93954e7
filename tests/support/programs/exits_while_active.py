# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Ends while something is still active.

Arguments: what is active; what inserts transforms, "receiver" or "executor".
"""

import os
import signal
import sys
import threading
from contextlib import suppress

import rclpy
from rclpy.duration import Duration
from rclpy.time import Time
from times_and_transforms import transform

from tf2_ros import Buffer, StaticTransformBroadcaster, TransformListener, transform_listener
from tf2_ros._wait.call_runners import call_queue_of

printed = []


def look_up(buffer):
    buffer.can_transform("map", "robot", Time(), Duration(seconds=60))


def keep_running(how):
    if threading.main_thread().is_alive() or printed:
        return
    printed.append(how)
    print("after the end", flush=True)
    if how == "thread":
        rclpy.shutdown()
    else:
        os.kill(os.getpid(), signal.SIGINT)


def main(how, inserter):
    global future  # which ends with the modules
    if inserter == "executor":
        transform_listener.problem = lambda: "it is new"
    rclpy.init()
    node = rclpy.create_node("ending")
    buffer = Buffer(node=node)
    if how == "unspun":
        TransformListener(buffer, node)
    elif how in ("thread", "interrupted"):
        TransformListener(buffer, node, spin_thread=True)
        node.create_timer(0.01, lambda: keep_running(how))
    elif how == "hidden":
        TransformListener(buffer, None)
    elif how == "shutdown":
        TransformListener(buffer, node, spin_thread=True)
        rclpy.shutdown()
    elif how == "waiting":
        TransformListener(buffer, None)
        threading.Thread(target=look_up, args=(buffer,), daemon=True).start()
        while not buffer.statistics()["waiters"]:
            threading.Event().wait(0.001)
    elif how == "future":
        future = buffer.wait_for_transform_async("map", "robot", Time(), timeout=Duration(seconds=60))
    elif how == "closed":
        with suppress(KeyboardInterrupt), TransformListener(buffer, node, spin_thread=True):
            signal.raise_signal(signal.SIGINT)
    elif how == "called back":
        TransformListener(buffer, node)
        rclpy.spin_once(node, timeout_sec=0)  # an executor has the queue, and runs nothing any more
        call_queue_of(node).put(print)
    elif how == "called back at the very end":
        TransformListener(buffer, node)
        rclpy.spin_once(node, timeout_sec=0)
        future = buffer.wait_for_transform_async("map", "robot", Time())
        future.add_done_callback(print)
        StaticTransformBroadcaster(node).sendTransform(transform("map", "robot"))
        while not call_queue_of(node).calls:
            threading.Event().wait(0.001)
    print("at the end", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
