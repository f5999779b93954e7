# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Listeners with the profile of sensor data, which other subscriptions of the program use, too."""

import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu

import tf2_ros


def shown(profile):
    return f"{profile.reliability.name} {profile.depth}"


rclpy.init()
node = rclpy.create_node("listening")
first = tf2_ros.TransformListener(tf2_ros.Buffer(), node)
listener = tf2_ros.TransformListener(tf2_ros.Buffer(), node, qos=qos_profile_sensor_data)
print("the listener's:", shown(listener.tf_sub.qos_profile))
print("the global one:", shown(qos_profile_sensor_data))
imu = node.create_subscription(Imu, "imu", lambda imu: None, qos_profile_sensor_data)
print("of another subscription:", shown(imu.qos_profile))

rclpy.shutdown()
