# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt
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

_Point = TypeVar("_Point", PointStamped, Point, Point32)
_Vector = TypeVar("_Vector", Vector3Stamped, Vector3)

def do_transform_point(point: _Point, transform: TransformStamped | Transform) -> _Point: ...
def do_transform_pose(pose: Pose, transform: TransformStamped | Transform) -> Pose: ...
def do_transform_pose_stamped(pose: PoseStamped, transform: TransformStamped) -> PoseStamped: ...
def do_transform_pose_with_covariance(
    pose: PoseWithCovariance, transform: TransformStamped | Transform
) -> PoseWithCovariance: ...
def do_transform_pose_with_covariance_stamped(
    pose: PoseWithCovarianceStamped, transform: TransformStamped
) -> PoseWithCovarianceStamped: ...
def do_transform_quaternion(
    quaternion: Quaternion, transform: TransformStamped | Transform
) -> Quaternion: ...
def do_transform_quaternion_stamped(
    quaternion: QuaternionStamped, transform: TransformStamped
) -> QuaternionStamped: ...
def do_transform_transform(content: Transform, transform: TransformStamped | Transform) -> Transform: ...
def do_transform_transform_stamped(
    content: TransformStamped, transform: TransformStamped
) -> TransformStamped: ...
def do_transform_vector3(vector3: _Vector, transform: TransformStamped | Transform) -> _Vector: ...
def transform_covariance(
    cov_in: Sequence[float] | npt.NDArray[np.float64], transform: TransformStamped | Transform
) -> npt.NDArray[np.float64]: ...
def do_transform_polygon(polygon: Polygon, transform: TransformStamped | Transform) -> Polygon: ...
def do_transform_polygon_stamped(polygon: PolygonStamped, transform: TransformStamped) -> PolygonStamped: ...
def do_transform_pose_array(poses: PoseArray, transform: TransformStamped) -> PoseArray: ...
def do_transform_accel_stamped(accel: AccelStamped, transform: TransformStamped) -> AccelStamped: ...
def do_transform_twist_stamped(twist: TwistStamped, transform: TransformStamped) -> TwistStamped: ...
def do_transform_velocity_stamped(
    velocity: VelocityStamped, transform: TransformStamped
) -> VelocityStamped: ...
def do_transform_wrench(wrench: Wrench, transform: TransformStamped | Transform) -> Wrench: ...
def do_transform_wrench_stamped(wrench: WrenchStamped, transform: TransformStamped) -> WrenchStamped: ...
