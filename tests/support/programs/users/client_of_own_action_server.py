# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A buffer client asks an action server, which answers from a buffer of its own, in the same program."""

import threading
import time

import rclpy
from geometry_msgs.msg import PointStamped, TransformStamped
from rclpy.action import ActionServer
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.time import Time

import tf2_geometry_msgs  # noqa: F401
import tf2_ros
from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error


class SmallServer(Node):
    CODES = (
        (tf2_ros.LookupException, TF2Error.LOOKUP_ERROR),
        (tf2_ros.ConnectivityException, TF2Error.CONNECTIVITY_ERROR),
        (tf2_ros.ExtrapolationException, TF2Error.EXTRAPOLATION_ERROR),
        (tf2_ros.InvalidArgumentException, TF2Error.INVALID_ARGUMENT_ERROR),
    )

    def __init__(self):
        super().__init__("small_server")
        self.buffer = tf2_ros.Buffer()
        self.asked_for = set()
        self.server = ActionServer(self, LookupTransform, "small_buffer", self.execute)

    def execute(self, handle):
        goal, result = handle.request, LookupTransform.Result()
        self.asked_for.add(f"{goal.source_frame or 'nothing'} in {goal.target_frame}")
        source_time = Time.from_msg(goal.source_time)
        try:
            if goal.advanced:
                result.transform = self.buffer.lookup_transform_full(
                    goal.target_frame,
                    Time.from_msg(goal.target_time),
                    goal.source_frame,
                    source_time,
                    goal.fixed_frame,
                )
            else:
                result.transform = self.buffer.lookup_transform(
                    goal.target_frame, goal.source_frame, source_time
                )
        except tf2_ros.TransformException as error:
            result.error.error = next(code for kind, code in self.CODES if isinstance(error, kind))
            result.error.error_string = f"the server says no to {goal.source_frame or 'nothing'}"
        handle.succeed()
        return result


def make(parent, child, stamp, x):
    t = TransformStamped()
    t.header.frame_id, t.child_frame_id, t.header.stamp.sec = parent, child, stamp
    t.transform.translation.x, t.transform.rotation.w = x, 1.0
    return t


def ask(client, *arguments):
    try:
        found = client.lookup_transform(*arguments)
    except tf2_ros.TransformException as error:
        print(f"{arguments[1] or 'nothing'}: {type(error).__name__}: {error}")
    else:
        print(f"{arguments[1]}: {found.header.frame_id} {found.transform.translation.x:.2f}")


def main():
    rclpy.init()
    server, asking = SmallServer(), rclpy.create_node("asking")
    for sec in (10, 20):
        server.buffer.set_transform(make("map", "ship", sec, float(sec)), "sea")
        server.buffer.set_transform(make("ship", "boat", sec, -1.0), "sea")
    server.buffer.set_transform(make("sky", "bird", 10, 1.0), "air")

    executor = MultiThreadedExecutor(4)
    executor.add_node(server)
    executor.add_node(asking)
    ending = threading.Event()

    def spin():
        while not ending.is_set():
            executor.spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=spin)
    thread.start()

    client = tf2_ros.BufferClient(
        asking, "small_buffer", check_frequency=50.0, timeout_padding=Duration(seconds=30)
    )
    deadline = time.monotonic() + 60
    while not client.can_transform("map", "boat", Time(), timeout=Duration(seconds=1)):
        if time.monotonic() > deadline:
            raise SystemExit("no server")

    ask(client, "map", "boat", Time())
    ask(client, "map", "ship", Time(seconds=12), Duration(seconds=1))
    ask(client, "ship", "boat", Time(seconds=15), Duration(seconds=1))
    ask(client, "map", "whale", Time())
    ask(client, "map", "bird", Time())
    ask(client, "map", "ship", Time(seconds=99))
    ask(client, "map", "", Time())

    full = client.lookup_transform_full("boat", Time(seconds=20), "boat", Time(seconds=10), "map")
    print("full:", full.header.frame_id, full.child_frame_id, round(full.transform.translation.x, 3))
    can = client.can_transform_full("boat", Time(seconds=20), "whale", Time(seconds=10), "map")
    print("can:", bool(client.can_transform("ship", "boat", Time())), bool(can))

    point = PointStamped()
    point.header.frame_id, point.header.stamp.sec = "boat", 20
    point.point.y = 0.5
    moved = client.transform(point, "map", Duration(seconds=1))
    print("point:", moved.header.frame_id, moved.point.x, moved.point.y)
    print(*sorted(server.asked_for), sep=", ")

    client.destroy()
    server.server.destroy()
    ending.set()
    thread.join()
    executor.shutdown()
    server.destroy_node()
    asking.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
