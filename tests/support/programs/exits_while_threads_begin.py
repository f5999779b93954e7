# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Ends while a thread has been started, and has not begun.

Argument: what starts the thread; after "interrupted", a signal handler raises while that waits for it.
"""

import signal
import sys
import threading
from contextlib import suppress

import rclpy
from rclpy.time import Time

from tf2_ros import Buffer, BufferClient, TransformListener
from tf2_ros._process.threads import callbacks
from tf2_ros.buffer_server import BufferServer

INTERRUPT_AFTER_S = 0.1  # in the middle of the time for which `late_threads.c` delays a thread


def start(what, node):
    buffer = Buffer()
    if what == "timeout":
        return buffer.wait_for_transform_async("map", "robot", Time(), timeout=60.0)
    if what == "callback":
        return callbacks.put(int)
    if what == "listener":
        return TransformListener(buffer, node)
    if what == "hidden":
        return TransformListener(buffer)
    if what == "spun":
        return TransformListener(buffer, node, spin_thread=True)
    if what == "client":
        return BufferClient(node, "tf2_buffer_server")
    return BufferServer(buffer, node, "tf2_buffer_server")


def main(what):
    rclpy.init()
    node = rclpy.create_node("ending")
    what = what.removeprefix("interrupted ")
    if what == sys.argv[1]:
        kept.append(start(what, node))
    else:
        # Other threads of this process have begun.
        TransformListener(Buffer(), node)
        while not {"tf2_ros receiver", "tf2_ros background"} <= {one.name for one in threading.enumerate()}:
            threading.Event().wait(0.01)
        with suppress(KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, INTERRUPT_AFTER_S)
            start(what, node)
            print("it was not interrupted")
    rclpy.shutdown()
    print("at the end", flush=True)


kept = []
if __name__ == "__main__":
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    main(sys.argv[1])
