from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import (
    Point,
    Point32,
    PointStamped,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    Transform,
    TransformStamped,
    Vector3,
    Vector3Stamped,
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
