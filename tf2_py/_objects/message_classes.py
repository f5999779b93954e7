# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Provide the message classes of transforms: from ROS, or stand-ins without ROS."""

# This module is imported when the first message is read or made, not earlier.
try:
    from builtin_interfaces.msg import Time
    from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Transform, TransformStamped, Vector3
    from std_msgs.msg import Header
except ModuleNotFoundError as missing:
    if (missing.name or "").partition(".")[0] not in ("builtin_interfaces", "geometry_msgs", "std_msgs"):
        raise
    from tf2_py._objects.message_standins import (
        Header,
        Point,
        Pose,
        PoseStamped,
        Quaternion,
        Time,
        Transform,
        TransformStamped,
        Vector3,
    )

__all__ = [
    "Header",
    "Point",
    "Pose",
    "PoseStamped",
    "Quaternion",
    "Time",
    "Transform",
    "TransformStamped",
    "Vector3",
]
