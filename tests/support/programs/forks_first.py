"""Forks a child before it starts ROS; the child listens to itself, and prints whether it received."""

import multiprocessing
import sys

import rclpy
from making import transform
from rclpy.duration import Duration
from rclpy.time import Time

import tf2_ros


def listen():
    rclpy.init()
    node = rclpy.create_node("forked")
    buffer = tf2_ros.Buffer(node=node)
    with tf2_ros.TransformListener(buffer, node):
        tf2_ros.StaticTransformBroadcaster(node).sendTransform(transform("map", "robot"))
        print(buffer.can_transform("map", "robot", Time(), Duration(seconds=10)), flush=True)
    rclpy.shutdown()


if __name__ == "__main__":
    tf2_ros.Buffer().can_transform("map", "robot", Time(), Duration(seconds=0.01))
    child = multiprocessing.get_context("fork").Process(target=listen)
    child.start()
    child.join()
    sys.exit(child.exitcode)
