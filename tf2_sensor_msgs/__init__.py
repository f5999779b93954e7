# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transform messages of sensor_msgs from frame to frame."""

import tf2_ros_cython._ros_requirement  # noqa: F401

from sensor_msgs.msg import PointCloud2 as PointCloud2  # public programs take it from here

from tf2_sensor_msgs._deskew import deskew as deskew
from tf2_sensor_msgs._imu_and_magnetometer import *  # noqa: F403
from tf2_sensor_msgs.tf2_sensor_msgs import do_transform_cloud, transform_points
from tf2_sensor_msgs.tf2_sensor_msgs import from_msg_msg as from_msg_msg
from tf2_sensor_msgs.tf2_sensor_msgs import to_msg_msg as to_msg_msg

# What `import *` imports from tf2's package.
__all__ = ["do_transform_cloud", "transform_points"]
