# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Subclasses of TransformListener: one renames frames, one records what it receives, both pass it on."""

import time

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer, StaticTransformBroadcaster, TransformBroadcaster, TransformListener


class RenamingListener(TransformListener):
    """For a recording of an old robot, whose frames had a leading slash and other names."""

    def __init__(self, buffer, node, names, **options):
        self.names = names
        super().__init__(buffer, node, **options)

    def _renamed(self, frame):
        frame = frame.lstrip("/")
        return self.names.get(frame, frame)

    def _rename(self, message):
        for one in message.transforms:
            one.header.frame_id = self._renamed(one.header.frame_id)
            one.child_frame_id = self._renamed(one.child_frame_id)
        return message

    def callback(self, data):
        super().callback(self._rename(data))

    def static_callback(self, data):
        super().static_callback(self._rename(data))


class RecordingListener(TransformListener):
    def __init__(self, buffer, node):
        self.log = []
        profile = QoSProfile(depth=10)
        static = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        TransformListener.__init__(self, buffer, node, qos=profile, static_qos=static)

    def callback(self, data):
        assert isinstance(data, TFMessage)
        self.log.append(("moves", [one.child_frame_id for one in data.transforms]))
        for one in data.transforms:
            self.buffer.set_transform(one, "recorder")

    def static_callback(self, data):
        self.log.append(("fixed", [one.child_frame_id for one in data.transforms]))
        super().static_callback(data)


def tf(parent, child, sec, z):
    message = TransformStamped()
    message.header.frame_id, message.child_frame_id = parent, child
    message.header.stamp.sec = sec
    message.transform.translation.z = z
    message.transform.rotation.w = 1.0
    return message


def spin_until(nodes, condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("still not so")
        for node in nodes:
            rclpy.spin_once(node, timeout_sec=0.02)


def main():
    rclpy.init()
    try:
        player, first, second = (rclpy.create_node(name) for name in ("player", "first", "second"))
        renamed, recorded = Buffer(), Buffer()
        renaming = RenamingListener(renamed, first, {"base": "base_link", "torso": "trunk"})
        recording = RecordingListener(recorded, second)
        dynamic, static = TransformBroadcaster(player), StaticTransformBroadcaster(player)
        nodes = [first, second]
        spin_until(nodes, lambda: dynamic.pub_tf.get_subscription_count() == 2)

        static.sendTransform(tf("base", "torso", 0, 0.5))
        dynamic.sendTransform([tf("odom", "base", 1, 0.1), tf("torso", "head", 1, 0.3)])
        dynamic.sendTransform(tf("odom", "base", 2, 0.2))
        spin_until(nodes, lambda: renamed.can_transform("odom", "head", Time(seconds=1)))
        spin_until(nodes, lambda: renamed.can_transform("odom", "base_link", Time(seconds=2)))
        spin_until(nodes, lambda: len(recording.log) == 3)

        head = renamed.lookup_transform("odom", "head", Time(seconds=1))
        print("head:", round(head.transform.translation.z, 3))
        middle = renamed.lookup_transform("odom", "base_link", Time(seconds=1, nanoseconds=500_000_000))
        print("half way:", round(middle.transform.translation.z, 3))
        for frame in ("base", "base_link", "torso", "trunk"):
            print(f"{frame}: renamed {bool(renamed.can_transform('head', frame, Time()))},", end=" ")
            print(f"recorded {bool(recorded.can_transform('head', frame, Time()))}")
        for kind in ("fixed", "moves"):
            print(kind, [frames for one, frames in recording.log if one == kind])

        # Fed by hand, as tests of users do it.
        renaming.callback(TFMessage(transforms=[tf("/head", "/hat", 1, 0.1)]))
        hat = renamed.lookup_transform("odom", "hat", Time())
        print("hat:", round(hat.transform.translation.z, 3))
        print("both listen:", renaming.buffer is renamed, recording.node is second)
        renaming.unregister()
        recording.unregister()
        for node in (player, *nodes):
            node.destroy_node()
    finally:
        rclpy.shutdown()


if __name__ == "__main__":
    main()
