# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Receives large messages, and prints whether a read inserts the whole of one, whether other threads of Python
run meanwhile, and whether the memory that only the message needed is given back.

With the middleware's own settings, which deliver within a process before the publisher returns.
"""

import ctypes
import sys
import threading
import time

import rclpy
from cdr_encoder import encode
from times_and_transforms import transform

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer, TransformListener

COUNT, TRIES = 10_000, 10


class Allocated(ctypes.Structure):
    """The result of mallinfo2."""

    NAMES = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = tuple((name, ctypes.c_size_t) for name in NAMES.split())


def allocated():
    """Bytes that the C library has given out."""
    mallinfo = ctypes.CDLL(None).mallinfo2
    mallinfo.restype = Allocated
    found = mallinfo()
    return found.uordblks + found.hblkhd


def count():
    global counted
    while True:
        counted += 1
        time.sleep(0.0001)


counted = 0
rclpy.init()
node = rclpy.create_node("large")
buffer = Buffer()
listener = TransformListener(buffer, node)
publisher = node.create_publisher(TFMessage, "/tf", 10)
while publisher.get_subscription_count() == 0:
    time.sleep(0.01)
sys.setswitchinterval(10)  # a thread runs only when another one releases the GIL
threading.Thread(target=count, daemon=True).start()
whole = running = 0
for attempt in range(TRIES):
    names = [f"f{attempt}_{i}" for i in range(COUNT)]
    data = encode([transform("map", name, 1) for name in names])
    publisher.publish(data)
    before = counted
    found = names[0] in buffer
    running += counted > before
    whole += found and all(name in buffer for name in names)
print(f"whole: {whole} of {TRIES}; other threads ran: {running > 0}")

# All for one sample: its bytes and what is parsed from them take 24 MB, the middleware keeps 9 MB.
data = encode([transform("map", "one", 1)] * 100_000)
before, taken = allocated(), buffer.statistics()["taken"]
publisher.publish(data)
while buffer.statistics()["taken"] < taken + 100_000:
    time.sleep(0.01)
print(f"memory is given back: {allocated() - before < 16 << 20}")
