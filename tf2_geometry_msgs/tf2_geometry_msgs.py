"""Owns what tf2_ros knows of the types of geometry_msgs, and of nav_msgs where that imports."""

from collections.abc import Callable
from typing import Any

import numpy as np

# Public programs take message classes from here, too.
from geometry_msgs.msg import (
    AccelStamped,
    Point,
    Point32,
    PointStamped,
    Polygon,
    PolygonStamped,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    Transform,
    TransformStamped,
    TwistStamped,
    Vector3,
    Vector3Stamped,
    VelocityStamped,
    Wrench,
    WrenchStamped,
)

from tf2_geometry_msgs._affine import (  # noqa: F401  used by programs, private as they are in tf2
    _build_affine,
    _decompose_affine,
    _get_mat_from_quat,
    _get_quat_from_mat,
    _transform_to_affine,
)
from tf2_geometry_msgs._lists import (
    do_transform_polygon,
    do_transform_polygon_stamped,
    do_transform_pose_array,
)
from tf2_geometry_msgs._motion import (
    do_transform_accel_stamped,
    do_transform_twist_stamped,
    do_transform_velocity_stamped,
    do_transform_wrench,
    do_transform_wrench_stamped,
)
from tf2_geometry_msgs._transform import (
    do_transform_point,
    do_transform_pose,
    do_transform_pose_stamped,
    do_transform_pose_with_covariance,
    do_transform_pose_with_covariance_stamped,
    do_transform_quaternion,
    do_transform_quaternion_stamped,
    do_transform_transform,
    do_transform_transform_stamped,
    do_transform_vector3,
    transform_covariance,
)
from tf2_ros._tf2_names import Iterable, Optional, Tuple, tf2_ros
from tf2_ros.buffer_interface import ConvertRegistration, TransformRegistration

# What `import *` gives from tf2's module, and nothing more: a name of ours could hide one of a program's.
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

_FUNCTIONS: dict[Any, Callable[[Any, Any], Any]] = {
    AccelStamped: do_transform_accel_stamped,
    Point: do_transform_point,
    Point32: do_transform_point,
    PointStamped: do_transform_point,
    Polygon: do_transform_polygon,
    PolygonStamped: do_transform_polygon_stamped,
    Pose: do_transform_pose,
    PoseArray: do_transform_pose_array,
    PoseStamped: do_transform_pose_stamped,
    PoseWithCovariance: do_transform_pose_with_covariance,
    PoseWithCovarianceStamped: do_transform_pose_with_covariance_stamped,
    Quaternion: do_transform_quaternion,
    QuaternionStamped: do_transform_quaternion_stamped,
    Transform: do_transform_transform,
    TransformStamped: do_transform_transform_stamped,
    TwistStamped: do_transform_twist_stamped,
    Vector3: do_transform_vector3,
    Vector3Stamped: do_transform_vector3,
    VelocityStamped: do_transform_velocity_stamped,
    Wrench: do_transform_wrench,
    WrenchStamped: do_transform_wrench_stamped,
}

try:
    from nav_msgs.msg import Odometry, Path
except ModuleNotFoundError as missing:
    if missing.name != "nav_msgs":
        raise
else:
    from tf2_geometry_msgs._nav import do_transform_odometry, do_transform_path

    _FUNCTIONS |= {Odometry: do_transform_odometry, Path: do_transform_path}


def to_msg_msg(msg: Any) -> Any:
    """Return `msg`, which is a message already."""
    return msg


def from_msg_msg(msg: Any) -> Any:
    """Return `msg`, which is a message already."""
    return msg


for _cls, _function in _FUNCTIONS.items():
    TransformRegistration().add(_cls, _function, default=True)
    ConvertRegistration().add_to_msg(_cls, to_msg_msg, default=True)
    ConvertRegistration().add_from_msg(_cls, from_msg_msg, default=True)
