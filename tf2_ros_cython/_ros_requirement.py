# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Raise an ImportError with advice if there is no ROS 2. Modules that need it import this module first."""

from tf2_ros_cython._ros_presence import HAS_ROS, absence

if not HAS_ROS:
    raise absence()
