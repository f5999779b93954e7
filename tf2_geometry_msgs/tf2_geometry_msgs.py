# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The names of tf2's module of this name; importing it registers the types of the table."""

from typing import Iterable, Optional, Tuple  # noqa: UP035  typing's, as in tf2

import numpy as np

# Public programs take message classes from here, too.
from geometry_msgs.msg import (
    Point,
    Point32,
    PointStamped,
    PolygonStamped,
    Pose,
    PoseStamped,
    PoseWithCovarianceStamped,
    TransformStamped,
    Vector3Stamped,
)

import tf2_ros
from tf2_geometry_msgs._affine import (  # noqa: F401  used by programs, private as they are in tf2
    _build_affine,
    _decompose_affine,
    _get_mat_from_quat,
    _get_quat_from_mat,
    _transform_to_affine,
)
from tf2_geometry_msgs._geometry import (
    do_transform_point,
    do_transform_polygon_stamped,
    do_transform_pose,
    do_transform_pose_stamped,
    do_transform_pose_with_covariance_stamped,
    do_transform_vector3,
    transform_covariance,
)
from tf2_geometry_msgs._type_table import TYPES
from tf2_ros._registration import from_msg_msg, register_messages, to_msg_msg

# What `import *` imports from tf2's module, and nothing more: our own names could hide those of a program.
__all__ = [
    "Iterable",
    "Optional",
    "Point",
    "Point32",
    "PointStamped",
    "PolygonStamped",
    "Pose",
    "PoseStamped",
    "PoseWithCovarianceStamped",
    "TransformStamped",
    "Tuple",
    "Vector3Stamped",
    "do_transform_point",
    "do_transform_polygon_stamped",
    "do_transform_pose",
    "do_transform_pose_stamped",
    "do_transform_pose_with_covariance_stamped",
    "do_transform_vector3",
    "from_msg_msg",
    "np",
    "tf2_ros",
    "to_msg_msg",
    "transform_covariance",
]

register_messages(TYPES)
