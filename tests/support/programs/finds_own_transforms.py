# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Publishes transforms, and reads each of them at once, in every way; prints what missed how many.

With the middleware's own settings, which deliver within a process before the publisher returns. So nothing,
or the receiver thread at this moment, has inserted the transform that a read must find.
"""

import pickle
import sys
import threading

import rclpy
from rclpy.duration import Duration
from rclpy.time import Time
from times_and_transforms import S, transform

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer, TransformListener

LATEST, AT_1 = Time(), Time(seconds=1)


def begins_a_wait(buffer, child):
    future = buffer.wait_for_transform_async("map", child, LATEST)
    return future.done() and future.result().child_frame_id == child


def clears(buffer, child):
    buffer.clear()
    return not buffer.can_transform("map", child, LATEST)


def goes_to_the_buffer_of_before(buffer, child):
    listener.buffer = Buffer()
    found = child in buffer and child not in listener.buffer
    listener.buffer = buffer
    return found


READS = {
    "lookup_transform": lambda b, c: b.lookup_transform("map", c, AT_1).transform.translation.x == 5,
    "lookup_transform_full": lambda b, c: b.lookup_transform_full("map", AT_1, c, AT_1, "map"),
    "lookup with a timeout": lambda b, c: b.lookup_transform("map", c, AT_1, Duration(seconds=9)),
    "lookup_transform_core": lambda b, c: b.lookup_transform_core("map", c, AT_1),
    "can_transform": lambda b, c: b.can_transform("map", c, LATEST),
    "can_transform_core": lambda b, c: b.can_transform_core("map", c, LATEST)[0],
    "lookup_transforms": lambda b, c: b.lookup_transforms("map", c, [S])[0][0][0] == 5,
    "transform_points": lambda b, c: b.transform_points([[0.0, 0, 0]], [S], "map", c)[0][0] == 5,
    "get_latest_common_time": lambda b, c: b.get_latest_common_time("map", c).nanoseconds == S,
    "the first try of a wait": begins_a_wait,
    "statistics": lambda b, c: b.statistics()["taken"] == published,
    "frames": lambda b, c: c in b.frames(),
    "tree": lambda b, c: c in b.tree(),
    "all_frames_as_yaml": lambda b, c: c in b.all_frames_as_yaml(),
    "all_frames_as_string": lambda b, c: c in b.all_frames_as_string(),
    "_frameExists": lambda b, c: b._frameExists(c),
    "_getFrameStrings": lambda b, c: c in b._getFrameStrings(),
    "_allFramesAsDot": lambda b, c: c in b._allFramesAsDot(),
    "in": lambda b, c: c in b,
    "repr": lambda b, c: f"{published + 1} frames" in repr(b),
    "pickle": lambda b, c: c in pickle.loads(pickle.dumps(b)),
    "_chain": lambda b, c: b._chain("map", AT_1, c, AT_1, "map") == [c, "map"],
    "assigning another buffer": goes_to_the_buffer_of_before,
    "clear": clears,
}
rounds, lookups = map(int, sys.argv[1:])
rclpy.init()
node = rclpy.create_node("finding")
listener = TransformListener(Buffer(), node)
publisher = node.create_publisher(TFMessage, "/tf", 100)
while not publisher.get_subscription_count():
    threading.Event().wait(0.005)
missed = dict.fromkeys(READS, 0)
for reads in [READS] * rounds + [["can_transform"] * lookups]:
    buffer = listener.buffer = Buffer()
    for published, read in enumerate(reads, 1):
        child = f"frame{published}"
        publisher.publish(TFMessage(transforms=[transform("map", child, 1, (5, 0, 0))]))
        try:
            missed[read] += not READS[read](buffer, child)
        except Exception:
            missed[read] += 1
print({read: count for read, count in missed.items() if count}, flush=True)
rclpy.shutdown()
