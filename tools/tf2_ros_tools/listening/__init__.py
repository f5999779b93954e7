# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Listen to a robot for commands, with a node of ROS or without ROS."""

__all__: list[str] = []
