# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The module from which programs for tf2 import StaticTransformListener."""

import tf2_ros_cython._ros_requirement  # noqa: F401

from tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC, StaticTransformListener

__all__ = ["DEFAULT_STATIC_TF_TOPIC", "DEFAULT_TF_TOPIC", "StaticTransformListener"]
