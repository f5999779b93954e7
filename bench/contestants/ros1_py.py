"""Owns the calls of ROS 1's tf2_py, as Debian packages it."""

import os

import rospy
from geometry_msgs.msg import TransformStamped
from serving import Tf2, serve

import tf2_py

S = 1_000_000_000


class Ros1(Tf2):
    message = TransformStamped

    def about(self):
        return {"version": os.environ["BENCH_VERSION"], "returns": "geometry_msgs/TransformStamped (ROS 1)"}

    def buffer_of(self, cache_ns):
        return tf2_py.BufferCore(rospy.Duration(cache_ns // S, cache_ns % S))

    def time_of(self, ns):
        return rospy.Time(ns // S, ns % S)

    stamp_of = time_of


if __name__ == "__main__":
    serve(Ros1())
