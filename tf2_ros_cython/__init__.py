# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The installation itself: which tf2 a program imports, and which ROS 2 it uses."""

__all__: list[str] = []
