# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Find out whether this process has ROS 2. Without it, tf2_ros is a library of buffers and recordings.

Importing this module raises an ImportError with advice if there is a ROS 2 without its tf2_msgs.
"""

from tf2_ros_cython._ros_in_use import absence, has_rclpy, require_messages

__all__ = ["HAS_ROS", "absence"]

# Determined once, because all modules must agree. An rclpy that is found but does not load is an error.
HAS_ROS = has_rclpy()

if HAS_ROS:
    require_messages()
