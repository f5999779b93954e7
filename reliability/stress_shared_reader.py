"""
Read the shared buffer of a stress run in another process: ``stress_shared_reader NAME SEED``.

It ends when the standard input does, and then prints how much it has checked.
"""

import json
import random
import sys
import threading

import rclpy

from reliability.stress_readers import Reader
from reliability.stress_truth import S
from tf2_ros import Buffer, TransformException

WAIT_S = 0.05


def main(name, seed):
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
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


if __name__ == "__main__":
    main(*sys.argv[1:])
