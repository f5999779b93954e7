# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

"""Transform what an IMU and a magnetometer measure."""

from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import Imu, MagneticField

def do_transform_imu(imu: Imu, transform: TransformStamped) -> Imu:
    """
    Rotate what an IMU measured from the child frame of ``transform`` to its parent frame: w' = R w, a' = R a.

    Both frames are fixed to the IMU. Both vectors and their covariances (R C R^T) are rotated. The reference
    point does not move: the acceleration is still that at the IMU. The orientation becomes that of the new
    frame in the same world, q' = q r^-1, with its old covariance, as in tf2's C++. A covariance that begins
    with -1 marks a missing estimate and stays unchanged, as does an orientation of zero length, or one that
    is missing and not finite.

    :param imu: an Imu, radians per second and meters per second squared.
    :param transform: a TransformStamped.
    :return: a new Imu with the transform's frame and stamp; its orientation has length one and w >= 0.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: a covariance is not 9 numbers, or a rotation is not finite.
    """

def do_transform_magnetic_field(magnetic_field: MagneticField, transform: TransformStamped) -> MagneticField:
    """
    Rotate a magnetic field from the child frame of ``transform`` to its parent frame: b' = R b.

    Its covariance becomes R C R^T. The translation has no effect.

    :param magnetic_field: a MagneticField, tesla.
    :param transform: a TransformStamped.
    :return: a new MagneticField with the transform's frame and stamp.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: a covariance is not 9 numbers, or the transform's rotation is not finite.
    """
