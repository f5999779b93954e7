"""Owns carrying what an IMU and a magnetometer measure into another frame."""

from libc.string cimport memcpy

from tf2_geometry_msgs._matrix cimport covariance_rotate, matrix_from_quaternion
from tf2_geometry_msgs._parts cimport (
    new_covariance,
    new_orientation,
    get_field,
    quaternion_layout,
    read_covariance,
    read_doubles,
    read_orientation,
    set_field,
    target_header,
)
from tf2_geometry_msgs._transform cimport carried_vector
from tf2_py._core.geometry cimport quaternion_conjugate, quaternion_multiply
from tf2_py._core.types cimport Transform
from tf2_py._objects.messages cimport Layout, read_transform

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


cdef object _carried_covariance(object covariance, const Transform* transform, bint may_be_absent):
    cdef double values[9]
    cdef double turned[9]
    cdef double matrix[9]
    read_covariance(covariance, 3, values)
    if may_be_absent and values[0] == -1.0:
        memcpy(turned, values, sizeof(values))
    else:
        matrix_from_quaternion(transform.rotation, matrix)
        covariance_rotate(matrix, values, 3, turned)
    return new_covariance(turned, 3)


cdef object _carried_attitude(object quaternion, const Transform* transform):
    # The attitude of the new frame, instead of the old one's, in the same world: q' = q r^-1.
    cdef double q[4]
    cdef double back[4]
    read_doubles(quaternion_layout, quaternion, q, 4)
    if q[0] == 0.0 and q[1] == 0.0 and q[2] == 0.0 and q[3] == 0.0:
        return quaternion_layout.new_doubles(q, 4)
    read_orientation(quaternion, q)
    quaternion_conjugate(transform.rotation, back)
    quaternion_multiply(q, back, q)
    return new_orientation(q)


cdef object _copied_covariance(object covariance):
    cdef double values[9]
    read_covariance(covariance, 3, values)
    return new_covariance(values, 3)


def do_transform_imu(imu, transform):
    """Express what an IMU measured in the axes of another frame that is fixed to it: w' = R w, a' = R a.

    Both vectors and their covariances (R C R^T) are rotated; the lever arm does not count: the acceleration
    is still that of the IMU's place. The orientation becomes that of the new frame in the same world,
    q' = q r^-1, with the covariance it had, as in upstream's C++. A covariance that begins with -1 marks an
    estimate as absent and stays as it is, and so does an orientation of zero length.

    :param imu: an Imu
    :param transform: a TransformStamped
    :returns: a new Imu with the transform's frame and stamp; its orientation has length one and w >= 0
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    cdef Layout layout = imu_layout
    read_transform(transform, &by)
    message = layout.new()
    set_field(layout, message, "header", target_header(transform))
    set_field(layout, message, "orientation", _carried_attitude(get_field(layout, imu, "orientation"), &by))
    covariance = get_field(layout, imu, "orientation_covariance")
    set_field(layout, message, "orientation_covariance", _copied_covariance(covariance))
    velocity = get_field(layout, imu, "angular_velocity")
    set_field(layout, message, "angular_velocity", carried_vector(velocity, &by))
    covariance = get_field(layout, imu, "angular_velocity_covariance")
    set_field(layout, message, "angular_velocity_covariance", _carried_covariance(covariance, &by, True))
    acceleration = get_field(layout, imu, "linear_acceleration")
    set_field(layout, message, "linear_acceleration", carried_vector(acceleration, &by))
    covariance = get_field(layout, imu, "linear_acceleration_covariance")
    set_field(layout, message, "linear_acceleration_covariance", _carried_covariance(covariance, &by, True))
    return message


def do_transform_magnetic_field(magnetic_field, transform):
    """Express a magnetic field in the axes of another frame: b' = R b, its covariance R C R^T.

    The translation counts for nothing.

    :param magnetic_field: a MagneticField, tesla
    :param transform: a TransformStamped
    :returns: a new MagneticField with the transform's frame and stamp
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    cdef Layout layout = magnetic_field_layout
    read_transform(transform, &by)
    message = layout.new()
    set_field(layout, message, "header", target_header(transform))
    field = get_field(layout, magnetic_field, "magnetic_field")
    set_field(layout, message, "magnetic_field", carried_vector(field, &by))
    covariance = get_field(layout, magnetic_field, "magnetic_field_covariance")
    set_field(layout, message, "magnetic_field_covariance", _carried_covariance(covariance, &by, False))
    return message
