# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The robot of the demonstration: `demo_robot.py PORT`. It sends transforms over Zenoh, without ROS 2, until its
standard input ends.
"""

import math
import sys
import threading
import time

import zenoh

from tf2_ros import TransformStamped
from tf2_ros_tools.live import connect

PERIOD_S = 0.02


def transform(parent: str, child: str, x: float, y: float, yaw: float) -> TransformStamped:
    made = TransformStamped(child_frame_id=child)
    made.header.frame_id = parent
    made.header.stamp.sec, made.header.stamp.nanosec = divmod(time.time_ns(), 10**9)
    made.transform.translation.x, made.transform.translation.y = x, y
    made.transform.rotation.z, made.transform.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return made


def main(port: int) -> None:
    config = zenoh.Config()
    for key, value in (
        ("mode", '"router"'),
        ("listen/endpoints", f'["tcp/127.0.0.1:{port}"]'),
        ("scouting/multicast/enabled", "false"),
    ):
        config.insert_json5(key, value)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    with zenoh.open(config), connect(f"zenoh://127.0.0.1:{port}") as feed:
        feed.static_broadcaster().sendTransform(transform("base_link", "camera", 0.3, 0.0, 0.0))
        moving = feed.broadcaster()
        print("sends", flush=True)
        while not ended.wait(PERIOD_S):
            angle = time.time() % (2 * math.pi)
            pose = (2 * math.cos(angle), 2 * math.sin(angle), angle + math.pi / 2)
            moving.sendTransform(transform("map", "base_link", *pose))


main(int(sys.argv[1]))
