"""
Owns whether this process has a ROS 2. Without one, tf2_ros is a library of buffers and recordings.

Importing this module raises ImportError, naming what to do, where there is a ROS 2 without its tf2_msgs.
"""

from tf2_ros_cython._ros import absence, has_rclpy, require_messages

__all__ = ["HAS_ROS", "absence"]

# Found once, for all modules must agree. An rclpy that is found and does not load is an error, no absence.
HAS_ROS = has_rclpy()

if HAS_ROS:
    require_messages()
