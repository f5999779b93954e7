"""
Breaks what a buffer counts, and inserts.

A debug build ends it by abort, see `tf2_py/_core/self_check.pxd`; others do not notice.
"""

import ctypes

from geometry_msgs.msg import TransformStamped

from tf2_py import BufferCore

COUNT = 777  # of samples; where the buffer keeps this number, it keeps another one afterwards

buffer = BufferCore()
message = TransformStamped(child_frame_id="odom")
message.header.frame_id, message.transform.rotation.w = "map", 1.0
for i in range(COUNT):
    message.header.stamp.nanosec = i + 1
    buffer.set_transform(message, "")
words = (ctypes.c_uint64 * (BufferCore.__basicsize__ // 8)).from_address(id(buffer))
counts = [i for i, word in enumerate(words) if word == COUNT]
assert counts and buffer.statistics()["samples"] == COUNT
for i in counts:
    words[i] = COUNT + 1
buffer.set_transform(message, "")
for i in counts:
    words[i] -= 1
print("not noticed")
