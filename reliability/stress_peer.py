"""
Run the other processes of a stress run: ``publish``, and ``read NAME SEED`` of a shared buffer.

Each ends when its standard input does; a reader then prints how much it has checked.
"""

import json
import random
import sys
import threading
import time

import rclpy

from reliability.stress_readers import Reader
from reliability.stress_truth import SENT, START_NS, STEP_NS, S, sample
from tf2_ros import Buffer, TransformException

RATE = 100  # messages a second
WAIT_S = 0.05


def publish(ended):
    from rclpy.qos import QoSProfile

    from tf2_msgs.msg import TFMessage

    rclpy.init()
    node = rclpy.create_node("stress_publisher")
    publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
    began, number = time.monotonic(), 0
    while not ended.wait(max(0.0, began + number / RATE - time.monotonic())):
        time_ns = START_NS + number * STEP_NS
        publisher.publish(TFMessage(transforms=[sample(frame, time_ns) for frame in SENT]))
        number += 1
    node.destroy_node()
    rclpy.try_shutdown()
    print(json.dumps({"messages": number}), flush=True)


def read(ended, name, seed):
    rclpy.logging.set_logger_level("tf2_py", rclpy.logging.LoggingSeverity.ERROR)
    rng = random.Random(int(seed))
    buffer = Buffer(attach=name)
    counts = {"waited": 0}
    reader = Reader(buffer, rng)
    while not ended.is_set():
        for _ in range(20):
            reader.step()
        try:
            # Something that the owner has not inserted yet.
            newest_ns = buffer.get_latest_common_time("world", "exact").nanoseconds
            buffer.lookup_transform("world", "exact", newest_ns + S // 50, WAIT_S)
            counts["waited"] += 1
        except TransformException:
            continue
    buffer._self_check()
    assert buffer._tf2_attachment.is_attached, "it has lost its owner"
    print(json.dumps({**counts, **reader.counts}), flush=True)


def main(what, *arguments):
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    {"publish": publish, "read": read}[what](ended, *arguments)


if __name__ == "__main__":
    main(*sys.argv[1:])
