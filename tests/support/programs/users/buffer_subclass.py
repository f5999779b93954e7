# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A subclass of Buffer for a fleet: it knows which robot it belongs to, filters what comes, and counts."""

import collections
import threading

import rclpy
import yaml
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

import tf2_ros
from tf2_msgs.srv import FrameGraph


class RobotBuffer(tf2_ros.Buffer):
    """Frames without a slash are the robot's own; other robots' frames are kept out."""

    def __init__(self, robot, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.robot = robot
        self.seen = collections.Counter()
        self.lookups = []
        self.changed = threading.Event()

    def _own(self, frame):
        return frame if "/" in frame or frame == "map" else f"{self.robot}/{frame}"

    def set_transform(self, transform, authority):
        self.seen["dynamic", authority] += 1
        if transform.child_frame_id.startswith(self.robot + "/"):
            super().set_transform(transform, authority)
        self.changed.set()

    def set_transform_static(self, transform, authority):
        self.seen["static", authority] += 1
        super().set_transform_static(transform, authority)
        self.changed.set()

    def lookup_transform(self, target_frame, source_frame, time, timeout=Duration()):  # noqa: B008
        self.lookups.append((target_frame, source_frame))
        return super().lookup_transform(self._own(target_frame), self._own(source_frame), time, timeout)

    def can_transform(self, target_frame, source_frame, time, timeout=Duration(), **more):  # noqa: B008
        return super().can_transform(self._own(target_frame), self._own(source_frame), time, timeout, **more)

    def distance(self, one, other):
        t = self.lookup_transform(one, other, Time()).transform.translation
        return (t.x**2 + t.y**2 + t.z**2) ** 0.5


class Fleet(Node):
    def __init__(self):
        super().__init__("fleet")
        self.buffer = RobotBuffer("r2", cache_time=Duration(seconds=60), node=self)
        self.listener = tf2_ros.TransformListener(self.buffer, self)
        self.out = tf2_ros.TransformBroadcaster(self)
        self.fixed = tf2_ros.StaticTransformBroadcaster(self)

    def wait_for(self, condition):
        end = self.get_clock().now() + Duration(seconds=60)
        while not condition():
            assert self.get_clock().now() < end, "too late"
            rclpy.spin_once(self, timeout_sec=0.1)


def transform(parent, child, x, y):
    t = TransformStamped(child_frame_id=child)
    t.header.frame_id, t.header.stamp.sec = parent, 50
    t.transform.translation.x, t.transform.translation.y, t.transform.rotation.w = x, y, 1.0
    return t


def main():
    rclpy.init()
    fleet = Fleet()
    buffer = fleet.buffer
    fleet.wait_for(lambda: fleet.out.pub_tf.get_subscription_count() > 0)
    print("a buffer:", isinstance(buffer, tf2_ros.BufferCore), isinstance(buffer, tf2_ros.BufferInterface))
    print("spun:", bool(buffer.can_transform("map", "base", Time())))

    for robot, x in (("r1", 10.0), ("r2", 3.0), ("r3", 30.0)):
        fleet.out.sendTransform(transform("map", f"{robot}/base", x, 4.0))
    fleet.fixed.sendTransform(
        [transform("r2/base", "r2/laser", 0.0, 1.0), transform("map", "gate", 0.0, 0.0)]
    )
    fleet.wait_for(lambda: sum(buffer.seen.values()) == 5)

    print("received:", sorted(buffer.seen.items()))
    print("distance of the base:", buffer.distance("map", "base"))
    print("distance of the laser:", round(buffer.distance("map", "laser"), 4))
    for frame in ("r1/base", "r2/base", "r3/base"):
        print(frame, "known:", bool(buffer.can_transform("map", frame, Time())))
    try:
        buffer.lookup_transform("map", "arm", Time(), timeout=Duration(seconds=0.1))
    except tf2_ros.LookupException as error:
        print("names the whole frame:", '"r2/arm"' in str(error))
    print("lookups:", buffer.lookups)

    buffer.set_transform(transform("r2/base", "r2/arm", 0.5, 0.0), "me")
    print("by hand:", buffer.lookup_transform("base", "arm", Time()).transform.translation.x)
    print("from me:", buffer.seen["dynamic", "me"], "event:", buffer.changed.is_set())

    client = fleet.create_client(FrameGraph, "tf2_frames")
    fleet.wait_for(client.service_is_ready)
    answer = client.call_async(FrameGraph.Request())
    fleet.wait_for(answer.done)
    for child, facts in sorted(yaml.safe_load(answer.result().frame_yaml).items()):
        print(f"{child}: in {facts['parent']}, from {facts['broadcaster']}")
    fleet.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
