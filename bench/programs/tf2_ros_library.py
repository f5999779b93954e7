# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""tf2_ros by the names that ROS 2 gives it: a sourced ROS 2's, or this project's."""

from builtin_interfaces.msg import Time as TimeMessage
from geometry_msgs.msg import TransformStamped
from measured_library import AUTHORITY, MeasuredLibrary
from rclpy.duration import Duration
from rclpy.time import Time

from tf2_ros import Buffer

S = 1_000_000_000


def fill(message, child, parent, stamp_ns, pose):
    message.header.frame_id = parent
    message.header.stamp = TimeMessage(sec=stamp_ns // S, nanosec=stamp_ns % S)
    message.child_frame_id = child
    translation, rotation = message.transform.translation, message.transform.rotation
    translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z, rotation.w = pose
    return message


class Tf2(MeasuredLibrary):
    ways = ("buffer", "core")

    def load(self, tree):
        self.buffer = Buffer(Duration(nanoseconds=tree.cache_ns))
        message = TransformStamped()
        for child, parent, static, stamp_ns, pose in tree.transforms():
            insert = self.buffer.set_transform_static if static else self.buffer.set_transform
            insert(fill(message, child, parent, stamp_ns, pose), AUTHORITY)

    def calls(self, way, queries):
        function = self.buffer.lookup_transform if way == "buffer" else self.buffer.lookup_transform_core
        return function, [(target, source, self.time_of(ns)) for target, source, ns in queries]

    def time_of(self, ns):
        return Time(nanoseconds=ns)

    def inserts(self, way, transforms):
        messages = [fill(TransformStamped(), *transform) for transform in transforms]
        return self.buffer.set_transform, [(message, AUTHORITY) for message in messages], 1
