# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Provide what commands do with a node of ROS: spin, listen and publish."""

__all__: list[str] = []
