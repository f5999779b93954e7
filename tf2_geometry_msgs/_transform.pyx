"""Owns carrying points, vectors, poses, rotations and transforms of geometry_msgs into another frame."""

from tf2_geometry_msgs._matrix cimport covariance_rotate, matrix_from_quaternion
from tf2_geometry_msgs._parts cimport (
    new_covariance,
    new_orientation,
    new_pose,
    get_field,
    point32_layout,
    point_layout,
    read_covariance,
    read_doubles,
    read_orientation,
    read_pose,
    set_field,
    target_header,
    vector3_layout,
)
from tf2_py._core.geometry cimport quaternion_multiply, transform_compose, vector_rotate
from tf2_py._core.types cimport Transform
from tf2_py._objects.messages cimport Layout, read_transform, transform_layout, transform_stamped_layout

from geometry_msgs.msg import (
    PointStamped,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    QuaternionStamped,
    Vector3Stamped,
)

cdef Layout point_stamped_layout = Layout(PointStamped, ("header", "point"))
cdef Layout vector3_stamped_layout = Layout(Vector3Stamped, ("header", "vector"))
cdef Layout quaternion_stamped_layout = Layout(QuaternionStamped, ("header", "quaternion"))
cdef Layout pose_stamped_layout = Layout(PoseStamped, ("header", "pose"))
cdef Layout pose_with_covariance_layout = Layout(PoseWithCovariance, ("pose", "covariance"))
cdef Layout pose_with_covariance_stamped_layout = Layout(PoseWithCovarianceStamped, ("header", "pose"))


cdef object stamped(Layout layout, str name, object content, object transform):
    message = layout.new()
    set_field(layout, message, "header", target_header(transform))
    set_field(layout, message, name, content)
    return message


cdef object carried_point(Layout layout, object point, const Transform* transform):
    cdef double xyz[3]
    cdef int i
    read_doubles(layout, point, xyz, 3)
    vector_rotate(transform.rotation, xyz, xyz)
    for i in range(3):
        xyz[i] += transform.translation[i]
    return layout.new_doubles(xyz, 3)


cdef object carried_vector(object vector, const Transform* transform):
    cdef double xyz[3]
    read_doubles(vector3_layout, vector, xyz, 3)
    vector_rotate(transform.rotation, xyz, xyz)
    return vector3_layout.new_doubles(xyz, 3)


cdef object carried_pose(object pose, const Transform* transform):
    cdef Transform carried
    read_pose(pose, &carried)
    transform_compose(transform, &carried, &carried)
    return new_pose(&carried)


cdef object carried_pose_with_covariance(object pose, const Transform* transform):
    cdef Layout layout = pose_with_covariance_layout
    covariance = get_field(layout, pose, "covariance")
    message = layout.new()
    set_field(layout, message, "pose", carried_pose(get_field(layout, pose, "pose"), transform))
    set_field(layout, message, "covariance", _carried_covariance(covariance, transform))
    return message


cdef object _carried_covariance(object covariance, const Transform* transform):
    cdef double values[36]
    cdef double turned[36]
    cdef double matrix[9]
    read_covariance(covariance, 6, values)
    matrix_from_quaternion(transform.rotation, matrix)
    covariance_rotate(matrix, values, 6, turned)
    return new_covariance(turned, 6)


cdef object _carried_quaternion(object quaternion, const Transform* transform):
    cdef double q[4]
    read_orientation(quaternion, q)
    quaternion_multiply(transform.rotation, q, q)
    return new_orientation(q)


cdef object _carried_transform(object content, const Transform* transform):
    cdef Transform carried
    read_doubles(vector3_layout, get_field(transform_layout, content, "translation"), carried.translation, 3)
    read_orientation(get_field(transform_layout, content, "rotation"), carried.rotation)
    transform_compose(transform, &carried, &carried)
    message = transform_layout.new()
    set_field(transform_layout, message, "translation", vector3_layout.new_doubles(carried.translation, 3))
    set_field(transform_layout, message, "rotation", new_orientation(carried.rotation))
    return message


cdef bint _has_axes(object message):
    # A quaternion has x, y and z, too, and is no vector.
    return hasattr(message, "x") and not hasattr(message, "w")


def transform_covariance(cov_in, transform):
    """Rotate the covariance matrix of a pose.

    Both 3x3 blocks on the diagonal (position, rotation) and both cross blocks C become R C R^T; the
    translation counts for nothing, as upstream. A symmetric matrix stays exactly symmetric.
    Formula: A. Leon-Garcia, Probability, Statistics, and Random Processes for Electrical Engineering,
    3rd ed., 2008, "Linear transformations of random vectors".

    :param cov_in: 36 numbers, row by row: the 6x6 covariance of x y z in metres and of the rotations about
        x y z in radians
    :param transform: a TransformStamped or Transform
    :returns: a float64 array of shape (36,)
    :raises TypeError: for anything else
    :raises ValueError: for another count of numbers, or a transform whose rotation is not finite
    """
    cdef Transform by
    read_transform(transform, &by)
    return _carried_covariance(cov_in, &by)


def do_transform_point(point, transform):
    """Carry a point into the frame of a transform: p' = R p + t.

    :param point: a PointStamped, or a Point or Point32, metres
    :param transform: a TransformStamped; for a point without a header a Transform will do
    :returns: a new message of the type given; its header, if any, has the transform's frame and stamp
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    cdef Layout layout = point_layout
    read_transform(transform, &by)
    if type(point) is point_stamped_layout.message_class or not _has_axes(point):
        content = carried_point(point_layout, get_field(point_stamped_layout, point, "point"), &by)
        return stamped(point_stamped_layout, "point", content, transform)
    if isinstance(point, point32_layout.message_class):
        layout = point32_layout
    return carried_point(layout, point, &by)


def do_transform_vector3(vector3, transform):
    """Turn a free vector into the frame of a transform: v' = R v. The translation counts for nothing.

    :param vector3: a Vector3Stamped or Vector3
    :param transform: a TransformStamped, which stays as it is; for a Vector3 a Transform will do
    :returns: a new message of the type given; its header, if any, has the transform's frame and stamp
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    read_transform(transform, &by)
    if type(vector3) is vector3_stamped_layout.message_class or not _has_axes(vector3):
        content = carried_vector(get_field(vector3_stamped_layout, vector3, "vector"), &by)
        return stamped(vector3_stamped_layout, "vector", content, transform)
    return carried_vector(vector3, &by)


def do_transform_quaternion(quaternion, transform):
    """Carry an orientation into the frame of a transform: q' = r q, the transform's rotation on the left.

    :param quaternion: a Quaternion; of any length, zero counts as no rotation
    :param transform: a TransformStamped or Transform
    :returns: a new Quaternion of length one with w >= 0
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    read_transform(transform, &by)
    return _carried_quaternion(quaternion, &by)


def do_transform_quaternion_stamped(quaternion, transform):
    """`do_transform_quaternion` for a QuaternionStamped and a TransformStamped.

    :returns: a new QuaternionStamped with the transform's frame and stamp
    """
    cdef Transform by
    read_transform(transform, &by)
    content = _carried_quaternion(get_field(quaternion_stamped_layout, quaternion, "quaternion"), &by)
    return stamped(quaternion_stamped_layout, "quaternion", content, transform)


def do_transform_pose(pose, transform):
    """Carry a pose into the frame of a transform: p' = R p + t, q' = r q.

    :param pose: a Pose, metres; its orientation of any length, zero counts as no rotation
    :param transform: a TransformStamped or Transform
    :returns: a new Pose; its orientation has length one and w >= 0
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    read_transform(transform, &by)
    return carried_pose(pose, &by)


def do_transform_pose_stamped(pose, transform):
    """`do_transform_pose` for a PoseStamped and a TransformStamped.

    :returns: a new PoseStamped with the transform's frame and stamp
    """
    cdef Transform by
    read_transform(transform, &by)
    content = carried_pose(get_field(pose_stamped_layout, pose, "pose"), &by)
    return stamped(pose_stamped_layout, "pose", content, transform)


def do_transform_pose_with_covariance(pose, transform):
    """`do_transform_pose` for a PoseWithCovariance; its covariance as by `transform_covariance`.

    :returns: a new PoseWithCovariance
    """
    cdef Transform by
    read_transform(transform, &by)
    return carried_pose_with_covariance(pose, &by)


def do_transform_pose_with_covariance_stamped(pose, transform):
    """`do_transform_pose_with_covariance` for a PoseWithCovarianceStamped and a TransformStamped.

    :returns: a new PoseWithCovarianceStamped with the transform's frame and stamp
    """
    cdef Transform by
    read_transform(transform, &by)
    content = carried_pose_with_covariance(get_field(pose_with_covariance_stamped_layout, pose, "pose"), &by)
    return stamped(pose_with_covariance_stamped_layout, "pose", content, transform)


def do_transform_transform(content, transform):
    """Put one transform behind another: T' = T_transform T_content.

    :param content: a Transform
    :param transform: a TransformStamped or Transform
    :returns: a new Transform; its rotation has length one and w >= 0
    :raises TypeError: for other types
    :raises ValueError: where the rotation of `transform` is not finite
    """
    cdef Transform by
    read_transform(transform, &by)
    return _carried_transform(content, &by)


def do_transform_transform_stamped(content, transform):
    """`do_transform_transform` for two TransformStamped.

    :returns: a new TransformStamped with the frame and stamp of `transform` and the child of `content`
    """
    cdef Transform by
    cdef Layout layout = transform_stamped_layout
    read_transform(transform, &by)
    message = layout.new()
    set_field(layout, message, "header", target_header(transform))
    set_field(layout, message, "child_frame_id", get_field(layout, content, "child_frame_id"))
    set_field(layout, message, "transform", _carried_transform(get_field(layout, content, "transform"), &by))
    return message
