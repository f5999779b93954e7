"""Owns transforming points, vectors, poses, rotations and transforms of geometry_msgs."""

from tf2_geometry_msgs._matrix cimport covariance_rotate, matrix_from_quaternion
from tf2_geometry_msgs._parts cimport (
    get_field,
    new_covariance,
    new_orientation,
    new_pose,
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
from tf2_py._internal cimport (
    Layout,
    Transform,
    quaternion_multiply,
    read_transform,
    transform_compose,
    transform_layout,
    transform_stamped_layout,
    vector_rotate,
)

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


cdef object transformed_point(Layout layout, object point, const Transform* transform):
    cdef double xyz[3]
    cdef int i
    read_doubles(layout, point, xyz, 3)
    vector_rotate(transform.rotation, xyz, xyz)
    for i in range(3):
        xyz[i] += transform.translation[i]
    return layout.new_doubles(xyz, 3)


cdef object rotated_vector(object vector, const Transform* transform):
    cdef double xyz[3]
    read_doubles(vector3_layout, vector, xyz, 3)
    vector_rotate(transform.rotation, xyz, xyz)
    return vector3_layout.new_doubles(xyz, 3)


cdef object transformed_pose(object pose, const Transform* transform):
    cdef Transform result
    read_pose(pose, &result)
    transform_compose(transform, &result, &result)
    return new_pose(&result)


cdef object transformed_pose_with_covariance(object pose, const Transform* transform):
    cdef Layout layout = pose_with_covariance_layout
    message = layout.new()
    set_field(layout, message, "pose", transformed_pose(get_field(layout, pose, "pose"), transform))
    covariance = get_field(layout, pose, "covariance")
    set_field(layout, message, "covariance", _rotated_covariance(covariance, transform))
    return message


cdef object _rotated_covariance(object covariance, const Transform* transform):
    cdef double values[36]
    cdef double rotated[36]
    cdef double matrix[9]
    read_covariance(covariance, 6, values)
    matrix_from_quaternion(transform.rotation, matrix)
    covariance_rotate(matrix, values, 6, rotated)
    return new_covariance(rotated, 6)


cdef object _rotated_quaternion(object quaternion, const Transform* transform):
    cdef double q[4]
    read_orientation(quaternion, q)
    quaternion_multiply(transform.rotation, q, q)
    return new_orientation(q)


cdef object _composed_transform(object content, const Transform* transform):
    cdef Transform result
    read_doubles(vector3_layout, get_field(transform_layout, content, "translation"), result.translation, 3)
    read_orientation(get_field(transform_layout, content, "rotation"), result.rotation)
    transform_compose(transform, &result, &result)
    message = transform_layout.new()
    set_field(transform_layout, message, "translation", vector3_layout.new_doubles(result.translation, 3))
    set_field(transform_layout, message, "rotation", new_orientation(result.rotation))
    return message


cdef bint _has_axes(object message):
    # A quaternion has x, y and z, too, and is no vector.
    return hasattr(message, "x") and not hasattr(message, "w")


def transform_covariance(
    cov_in: Sequence[float] | NDArray[np.float64], transform: TransformStamped | Transform
) -> NDArray[np.float64]:
    """
    Rotate the covariance matrix of a pose from the child frame of ``transform`` to its parent frame.

    Both 3x3 blocks on the diagonal (position, rotation) and both cross blocks C become R C R^T; the
    translation has no effect, as in tf2. A symmetric matrix stays exactly symmetric.
    Formula: A. Leon-Garcia, Probability, Statistics, and Random Processes for Electrical Engineering,
    3rd ed., 2008, "Linear transformations of random vectors".

    :param cov_in: 36 numbers, row by row: the 6x6 covariance of x y z in metres and of the rotations about
        x y z in radians.
    :param transform: a TransformStamped or Transform.
    :return: a float64 array of shape (36,).
    :raises TypeError: ``cov_in`` is no numbers, or ``transform`` is of another type.
    :raises ValueError: ``cov_in`` is another count of numbers, or the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    return _rotated_covariance(cov_in, &tf)


def do_transform_point(
    point: PointStamped | Point | Point32, transform: TransformStamped | Transform
) -> PointStamped | Point | Point32:
    """
    Transform a point from the child frame of ``transform`` to its parent frame: p' = R p + t.

    :param point: a PointStamped, Point or Point32, metres.
    :param transform: a TransformStamped; for a point without a header also a Transform; metres.
    :return: a new message of the same class; its header, if any, has the transform's frame and stamp.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    cdef Layout layout = point_layout
    read_transform(transform, &tf)
    if type(point) is point_stamped_layout.message_class or not _has_axes(point):
        content = transformed_point(point_layout, get_field(point_stamped_layout, point, "point"), &tf)
        return stamped(point_stamped_layout, "point", content, transform)
    if isinstance(point, point32_layout.message_class):
        layout = point32_layout
    return transformed_point(layout, point, &tf)


def do_transform_vector3(
    vector3: Vector3Stamped | Vector3, transform: TransformStamped | Transform
) -> Vector3Stamped | Vector3:
    """
    Rotate a vector from the child frame of ``transform`` to its parent frame: v' = R v.

    The translation does not count.

    :param vector3: a Vector3Stamped or Vector3, of any unit.
    :param transform: a TransformStamped; for a Vector3 also a Transform.
    :return: a new message of the same class; its header, if any, has the transform's frame and stamp.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    if type(vector3) is vector3_stamped_layout.message_class or not _has_axes(vector3):
        content = rotated_vector(get_field(vector3_stamped_layout, vector3, "vector"), &tf)
        return stamped(vector3_stamped_layout, "vector", content, transform)
    return rotated_vector(vector3, &tf)


def do_transform_quaternion(quaternion: Quaternion, transform: TransformStamped | Transform) -> Quaternion:
    """
    Rotate an orientation from the child frame of ``transform`` to its parent frame: q' = r q.

    :param quaternion: a Quaternion of any length; zero length counts as no rotation.
    :param transform: a TransformStamped or Transform.
    :return: a new Quaternion of length one with w >= 0.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    return _rotated_quaternion(quaternion, &tf)


def do_transform_quaternion_stamped(
    quaternion: QuaternionStamped, transform: TransformStamped
) -> QuaternionStamped:
    """
    Rotate an orientation, as ``do_transform_quaternion`` does.

    :param quaternion: a QuaternionStamped, of any length; zero length counts as no rotation.
    :param transform: a TransformStamped.
    :return: a new QuaternionStamped with the transform's frame and stamp.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    content = _rotated_quaternion(get_field(quaternion_stamped_layout, quaternion, "quaternion"), &tf)
    return stamped(quaternion_stamped_layout, "quaternion", content, transform)


def do_transform_pose(pose: Pose, transform: TransformStamped | Transform) -> Pose:
    """
    Transform a pose from the child frame of ``transform`` to its parent frame: p' = R p + t, q' = r q.

    :param pose: a Pose, metres; its orientation of any length; zero length counts as no rotation.
    :param transform: a TransformStamped or Transform, metres.
    :return: a new Pose; its orientation has length one and w >= 0.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    return transformed_pose(pose, &tf)


def do_transform_pose_stamped(pose: PoseStamped, transform: TransformStamped) -> PoseStamped:
    """
    Transform a pose, as ``do_transform_pose`` does.

    :param pose: a PoseStamped, metres.
    :param transform: a TransformStamped, metres.
    :return: a new PoseStamped with the transform's frame and stamp.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    content = transformed_pose(get_field(pose_stamped_layout, pose, "pose"), &tf)
    return stamped(pose_stamped_layout, "pose", content, transform)


def do_transform_pose_with_covariance(
    pose: PoseWithCovariance, transform: TransformStamped | Transform
) -> PoseWithCovariance:
    """
    Transform a pose as ``do_transform_pose`` does, and its covariance as ``transform_covariance`` does.

    :param pose: a PoseWithCovariance, metres and radians.
    :param transform: a TransformStamped or Transform, metres.
    :return: a new PoseWithCovariance.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the covariance is not 36 numbers, or the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    return transformed_pose_with_covariance(pose, &tf)


def do_transform_pose_with_covariance_stamped(
    pose: PoseWithCovarianceStamped, transform: TransformStamped
) -> PoseWithCovarianceStamped:
    """
    Transform a pose and its covariance, as ``do_transform_pose_with_covariance`` does.

    :param pose: a PoseWithCovarianceStamped, metres and radians.
    :param transform: a TransformStamped, metres.
    :return: a new PoseWithCovarianceStamped with the transform's frame and stamp.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the covariance is not 36 numbers, or the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    content = transformed_pose_with_covariance(
        get_field(pose_with_covariance_stamped_layout, pose, "pose"), &tf
    )
    return stamped(pose_with_covariance_stamped_layout, "pose", content, transform)


def do_transform_transform(content: Transform, transform: TransformStamped | Transform) -> Transform:
    """
    Carry a transform from the child frame of ``transform`` to its parent frame: T' = T_transform T_content.

    :param content: a Transform, metres.
    :param transform: a TransformStamped or Transform, metres.
    :return: a new Transform; its rotation has length one and w >= 0.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the rotation of ``transform`` is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    return _composed_transform(content, &tf)


def do_transform_transform_stamped(
    content: TransformStamped, transform: TransformStamped
) -> TransformStamped:
    """
    Compose two transforms, as ``do_transform_transform`` does.

    :param content: a TransformStamped, metres.
    :param transform: a TransformStamped, metres.
    :return: a new TransformStamped with the frame and stamp of ``transform`` and the child of ``content``.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the rotation of ``transform`` is not finite.
    """
    cdef Transform tf
    cdef Layout layout = transform_stamped_layout
    read_transform(transform, &tf)
    message = layout.new()
    set_field(layout, message, "header", target_header(transform))
    set_field(layout, message, "child_frame_id", get_field(layout, content, "child_frame_id"))
    set_field(layout, message, "transform", _composed_transform(get_field(layout, content, "transform"), &tf))
    return message
