"""Owns the calls of ROS 1's tf2_py, as Debian packages it."""

import os

import rospy
from geometry_msgs.msg import TransformStamped
from serving import Contestant, serve

import tf2_py

AUTHORITY = "bench"
S = 1_000_000_000


def fill(message, child, parent, stamp_ns, pose):
    message.header.frame_id, message.child_frame_id = parent, child
    message.header.stamp = rospy.Time(stamp_ns // S, stamp_ns % S)
    translation, rotation = message.transform.translation, message.transform.rotation
    translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z, rotation.w = pose
    return message


class Ros1(Contestant):
    def about(self):
        return {"version": os.environ["BENCH_VERSION"], "returns": "geometry_msgs/TransformStamped (ROS 1)"}

    def load(self, tree):
        self.buffer = tf2_py.BufferCore(rospy.Duration(tree.cache_ns // S, tree.cache_ns % S))
        message = TransformStamped()
        for child, parent, static, stamp_ns, pose in tree.records():
            fill(message, child, parent, stamp_ns, pose)
            if static:
                self.buffer.set_transform_static(message, AUTHORITY)
            else:
                self.buffer.set_transform(message, AUTHORITY)

    def calls(self, way, queries):
        return self.buffer.lookup_transform_core, [
            (target, source, rospy.Time(ns // S, ns % S)) for target, source, ns in queries
        ]

    def numbers(self, answer):
        t, q = answer.transform.translation, answer.transform.rotation
        return t.x, t.y, t.z, q.x, q.y, q.z, q.w

    def inserts(self, way, transforms):
        messages = [fill(TransformStamped(), *transform) for transform in transforms]
        return self.buffer.set_transform, [(message, AUTHORITY) for message in messages], 1


if __name__ == "__main__":
    serve(Ros1())
