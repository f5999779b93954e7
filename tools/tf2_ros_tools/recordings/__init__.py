# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read, correct, tabulate and save recordings; users import ``tf2_ros_tools.bag``."""

__all__: list[str] = []
