# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Makes all later imports of rclpy fail, as on a laptop without ROS 2."""

import sys

sys.modules["rclpy"] = None
