# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transform what an IMU and a magnetometer measure."""

from libc.math cimport isfinite

from tf2_geometry_msgs._geometry cimport (
    copied_covariance,
    get_field,
    new_orientation,
    quaternion_layout,
    read_doubles,
    read_orientation,
    rotated_covariance,
    rotated_vector,
    set_field,
    target_header,
)
from tf2_py._internal cimport Layout, Transform, quaternion_conjugate, quaternion_multiply, read_transform

from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import Imu, MagneticField

cdef Layout imu_layout = Layout(
    Imu,
    (
        "header",
        "orientation",
        "orientation_covariance",
        "angular_velocity",
        "angular_velocity_covariance",
        "linear_acceleration",
        "linear_acceleration_covariance",
    ),
)
cdef Layout magnetic_field_layout = Layout(
    MagneticField, ("header", "magnetic_field", "magnetic_field_covariance")
)


cdef object _transformed_attitude(object quaternion, bint is_estimate, const Transform* transform):
    # The attitude of the new frame in the same world: q' = q r^-1.
    cdef double q[4]
    cdef double back[4]
    read_doubles(quaternion_layout, quaternion, q, 4)
    if q[0] == 0.0 and q[1] == 0.0 and q[2] == 0.0 and q[3] == 0.0:
        return quaternion_layout.new_doubles(q, 4)
    if not is_estimate and not isfinite(q[0] + q[1] + q[2] + q[3]):
        return quaternion_layout.new_doubles(q, 4)
    read_orientation(quaternion, q, "orientation")
    quaternion_conjugate(transform.rotation, back)
    quaternion_multiply(q, back, q)
    return new_orientation(q)


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
    cdef Transform tf
    cdef Layout layout = imu_layout
    read_transform(transform, &tf)
    message = layout.new()
    set_field(layout, message, "header", target_header(transform))
    covariance = copied_covariance(get_field(layout, imu, "orientation_covariance"), 3)
    set_field(layout, message, "orientation_covariance", covariance)
    attitude = get_field(layout, imu, "orientation")
    set_field(layout, message, "orientation", _transformed_attitude(attitude, covariance[0] != -1.0, &tf))
    velocity = get_field(layout, imu, "angular_velocity")
    set_field(layout, message, "angular_velocity", rotated_vector(velocity, &tf))
    covariance = get_field(layout, imu, "angular_velocity_covariance")
    set_field(layout, message, "angular_velocity_covariance", rotated_covariance(covariance, 3, &tf, True))
    acceleration = get_field(layout, imu, "linear_acceleration")
    set_field(layout, message, "linear_acceleration", rotated_vector(acceleration, &tf))
    covariance = get_field(layout, imu, "linear_acceleration_covariance")
    set_field(layout, message, "linear_acceleration_covariance", rotated_covariance(covariance, 3, &tf, True))
    return message


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
    cdef Transform tf
    cdef Layout layout = magnetic_field_layout
    read_transform(transform, &tf)
    message = layout.new()
    set_field(layout, message, "header", target_header(transform))
    field = get_field(layout, magnetic_field, "magnetic_field")
    set_field(layout, message, "magnetic_field", rotated_vector(field, &tf))
    covariance = get_field(layout, magnetic_field, "magnetic_field_covariance")
    set_field(layout, message, "magnetic_field_covariance", rotated_covariance(covariance, 3, &tf, False))
    return message
