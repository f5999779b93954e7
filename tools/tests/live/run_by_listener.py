# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a node that uses tf2 does in the tests of played recordings."""

import threading

import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from rclpy.time import Time
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String

from tf2_ros import Buffer, TransformListener

TYPES = {"/scan": LaserScan, "/odom": Odometry, "/text": String}
DEPTH = 1000  # more than is played


class Listener:
    """Keeps what it receives: the transforms in `buffer`, and the messages of other topics in `heard`."""

    def __init__(self):
        rclpy.init(args=[])
        node = rclpy.create_node("listener")
        self.buffer, self.heard = Buffer(node=node), {topic: [] for topic in TYPES}
        self._kept = [TransformListener(self.buffer, node)]
        for topic, kind in TYPES.items():
            self._kept.append(node.create_subscription(kind, topic, self.heard[topic].append, DEPTH))
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        threading.Thread(target=executor.spin, daemon=True).start()

    def counts(self):
        return {topic: len(messages) for topic, messages in self.heard.items()}

    def parents(self, *, static):
        """The parents of all static frames, or of all others."""
        frames = self.buffer.frames().items()
        return {name: one.parent for name, one in frames if one.parent and one.static == static}

    def newest_ns(self):
        """The newest stamps of frames that move."""
        return [one.newest_ns for one in self.buffer.frames().values() if one.newest_ns is not None]

    def serialized(self, topic):
        return [bytes(serialize_message(one)).hex() for one in self.heard[topic]]

    def poses(self, target, topic):
        """The poses of the messages' frames at the messages' stamps: x y z and x y z w."""
        poses = []
        for one in self.heard[topic]:
            stamp = Time.from_msg(one.header.stamp)
            m = self.buffer.lookup_transform(target, one.header.frame_id, stamp).transform
            t, q = m.translation, m.rotation
            poses.append([t.x, t.y, t.z, q.x, q.y, q.z, q.w])
        return poses
