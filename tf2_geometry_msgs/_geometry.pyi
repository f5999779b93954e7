# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

"""
Transform the types of geometry_msgs: points, vectors, poses, rotations, transforms; lists of them; wrenches,
velocities and accelerations.
"""

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

def do_transform_point(point: _Point, transform: TransformStamped | Transform) -> _Point:
    """
    Transform a point from the child frame of ``transform`` to its parent frame: p' = R p + t.

    :param point: a PointStamped, Point or Point32, meters.
    :param transform: a TransformStamped; for a point without a header also a Transform; meters.
    :return: a new message of the same class; its header, if any, has the transform's frame and stamp.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: a rotation is not finite. Coordinates may be NaN or infinite.
    """

def do_transform_pose(pose: Pose, transform: TransformStamped | Transform) -> Pose:
    """
    Transform a pose from the child frame of ``transform`` to its parent frame: p' = R p + t, q' = r q.

    :param pose: a Pose, meters; its orientation of any length; zero length means no rotation.
    :param transform: a TransformStamped or Transform, meters.
    :return: a new Pose; its orientation has length one and w >= 0.
    :raises TypeError, ValueError: as ``do_transform_point``.
    """

def do_transform_pose_stamped(pose: PoseStamped, transform: TransformStamped) -> PoseStamped:
    """Transform a pose, as ``do_transform_pose`` does; the result has the transform's frame and stamp."""

def do_transform_pose_with_covariance(
    pose: PoseWithCovariance, transform: TransformStamped | Transform
) -> PoseWithCovariance:
    """
    Transform a pose as ``do_transform_pose`` does, and its covariance as ``transform_covariance`` does.

    :param pose: a PoseWithCovariance, meters and radians.
    :param transform: a TransformStamped or Transform, meters.
    :return: a new PoseWithCovariance.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: the covariance is not 36 numbers, or a rotation is not finite.
    """

def do_transform_pose_with_covariance_stamped(
    pose: PoseWithCovarianceStamped, transform: TransformStamped
) -> PoseWithCovarianceStamped:
    """
    Transform a pose and its covariance, as ``do_transform_pose_with_covariance`` does; the result has the
    transform's frame and stamp.
    """

def do_transform_quaternion(quaternion: Quaternion, transform: TransformStamped | Transform) -> Quaternion:
    """
    Rotate an orientation from the child frame of ``transform`` to its parent frame: q' = r q.

    :param quaternion: a Quaternion of any length; zero length means no rotation.
    :param transform: a TransformStamped or Transform.
    :return: a new Quaternion of length one with w >= 0.
    :raises TypeError, ValueError: as ``do_transform_point``.
    """

def do_transform_quaternion_stamped(
    quaternion: QuaternionStamped, transform: TransformStamped
) -> QuaternionStamped:
    """
    Rotate an orientation, as ``do_transform_quaternion`` does; the result has the transform's frame and
    stamp.
    """

def do_transform_transform(content: Transform, transform: TransformStamped | Transform) -> Transform:
    """
    Carry a transform from the child frame of ``transform`` to its parent frame: T' = T_transform T_content.

    :param content: a Transform, meters.
    :param transform: a TransformStamped or Transform, meters.
    :return: a new Transform; its rotation has length one and w >= 0.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: a rotation is not finite.
    """

def do_transform_transform_stamped(
    content: TransformStamped, transform: TransformStamped
) -> TransformStamped:
    """
    Compose two transforms, as ``do_transform_transform`` does; the result has the frame and stamp of
    ``transform`` and the child of ``content``.
    """

def do_transform_vector3(vector3: _Vector, transform: TransformStamped | Transform) -> _Vector:
    """
    Rotate a vector from the child frame of ``transform`` to its parent frame: v' = R v.

    The translation has no effect.

    :param vector3: a Vector3Stamped or Vector3, of any unit.
    :param transform: a TransformStamped; for a Vector3 also a Transform.
    :return: a new message of the same class; its header, if any, has the transform's frame and stamp.
    :raises TypeError, ValueError: as ``do_transform_point``.
    """

def transform_covariance(
    cov_in: Sequence[float] | npt.NDArray[np.float64], transform: TransformStamped | Transform
) -> npt.NDArray[np.float64]:
    """
    Rotate the covariance matrix of a pose from the child frame of ``transform`` to its parent frame.

    Both 3x3 blocks on the diagonal (position, rotation) and both cross blocks C become R C R^T; the
    translation has no effect, as in tf2. A symmetric matrix stays exactly symmetric.
    Formula: A. Leon-Garcia, Probability, Statistics, and Random Processes for Electrical Engineering,
    3rd ed., 2008, "Linear transformations of random vectors".

    :param cov_in: 36 numbers, row by row: the 6x6 covariance of x y z in meters and of the rotations about
        x y z in radians.
    :param transform: a TransformStamped or Transform.
    :return: a float64 array of shape (36,).
    :raises TypeError: ``cov_in`` does not consist of numbers, or ``transform`` is of another type.
    :raises ValueError: ``cov_in`` does not have 36 numbers, or the transform's rotation is not finite.
    """

def do_transform_polygon(polygon: Polygon, transform: TransformStamped | Transform) -> Polygon:
    """
    Transform each point of a polygon from the child frame of ``transform`` to its parent frame: p' = R p + t.

    In double precision: a new Point32 holds doubles, as every Python message does; it is rounded to float32
    when it is serialized.

    :param polygon: a Polygon of any number of Point32, meters.
    :param transform: a TransformStamped or Transform, meters.
    :return: a new Polygon.
    :raises TypeError, ValueError: as ``do_transform_point``.
    """

def do_transform_polygon_stamped(polygon: PolygonStamped, transform: TransformStamped) -> PolygonStamped:
    """
    Transform each point of a polygon, as ``do_transform_polygon`` does; the result has the transform's frame
    and stamp.
    """

def do_transform_pose_array(poses: PoseArray, transform: TransformStamped) -> PoseArray:
    """
    Transform each pose of an array, as ``do_transform_pose`` does; the result has the transform's frame and
    stamp.
    """

def do_transform_accel_stamped(accel: AccelStamped, transform: TransformStamped) -> AccelStamped:
    """
    Rotate an acceleration from the child frame of ``transform`` to its parent frame: a' = R a.

    Both vectors are rotated. The reference point does not move: the linear part is still the acceleration of
    the old point, in new axes. Moving the point would need the angular velocity, which the message lacks.

    :param accel: an AccelStamped, meters and radians per second squared.
    :param transform: a TransformStamped.
    :return: a new AccelStamped with the transform's frame and stamp.
    :raises TypeError, ValueError: as ``do_transform_point``.
    """

def do_transform_twist_stamped(twist: TwistStamped, transform: TransformStamped) -> TwistStamped:
    """
    Rotate a twist from the child frame of ``transform`` to its parent frame: v' = R v, w' = R w.

    Both vectors are rotated. The reference point does not move: v' is still the velocity of the old point, in
    new axes. ``do_transform_velocity_stamped`` moves the point as well.

    :param twist: a TwistStamped, meters and radians per second.
    :param transform: a TransformStamped.
    :return: a new TwistStamped with the transform's frame and stamp.
    :raises TypeError, ValueError: as ``do_transform_point``.
    """

def do_transform_velocity_stamped(velocity: VelocityStamped, transform: TransformStamped) -> VelocityStamped:
    """
    Transform a rigid body's velocity from the child frame of ``transform`` to its parent frame.

    The reference point moves from one origin to the other: w' = R w, v' = R v + t x w'.

    Both vectors are rotated. v' is the velocity of the point of the body at the origin of the new frame. The
    two frames are assumed not to move relative to each other. The tf2 of Jazzy adds the unrotated input to
    this and keeps the old header; later versions do not add it.
    Formula: K. M. Lynch and F. C. Park, Modern Robotics, 2017, equation 3.83 (the twist's adjoint).

    :param velocity: a VelocityStamped, meters and radians per second.
    :param transform: a TransformStamped, meters.
    :return: a new VelocityStamped with the transform's frame and stamp, and the frames that ``velocity``
        names.
    :raises TypeError, ValueError: as ``do_transform_point``.
    """

def do_transform_wrench(wrench: Wrench, transform: TransformStamped | Transform) -> Wrench:
    """
    Transform a wrench from the child frame of ``transform`` to its parent frame.

    The reference point moves from one origin to the other: f' = R f, torque' = R torque + t x f'.

    Both vectors are rotated. The force acted at the origin of the old frame (at t in the new frame), so it
    adds a torque about the new origin.
    Formula: K. M. Lynch and F. C. Park, Modern Robotics, 2017, section 3.4 (the wrench's adjoint).

    :param wrench: a Wrench, newtons and newton meters.
    :param transform: a TransformStamped or Transform, meters.
    :return: a new Wrench.
    :raises TypeError, ValueError: as ``do_transform_point``.
    """

def do_transform_wrench_stamped(wrench: WrenchStamped, transform: TransformStamped) -> WrenchStamped:
    """Transform a wrench, as ``do_transform_wrench`` does; the result has the transform's frame and stamp."""
