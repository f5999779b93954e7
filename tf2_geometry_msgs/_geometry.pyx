# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Transform the types of geometry_msgs: points, vectors, poses, rotations, transforms; lists of them; wrenches,
velocities and accelerations.
"""

from cpython.float cimport PyFloat_AS_DOUBLE, PyFloat_CheckExact
from cpython.object cimport PyObject
from cpython.unicode cimport PyUnicode_Check
from libc.string cimport memcpy

cimport numpy as cnp

from tf2_py._internal cimport (
    Layout,
    Transform,
    header_layout,
    load_layouts,
    matrix_from_quaternion,
    nanoseconds,
    new_header,
    quaternion_multiply,
    quaternion_normalize_any,
    read_transform,
    transform_compose,
    transform_layout,
    transform_stamped_layout,
    vector_rotate,
)

import numpy as np
from geometry_msgs.msg import (
    Accel,
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
    Transform as _TransformMessage,
    TransformStamped,
    Twist,
    TwistStamped,
    Vector3,
    Vector3Stamped,
    VelocityStamped,
    Wrench,
    WrenchStamped,
)

from tf2_py._internal import MalformedObjectError as _MalformedObjectError  # the package imports * from here

# The parts that messages share: read into C doubles, and made anew.

cdef extern from "Python.h":
    # Without counting references.
    Py_ssize_t PyTuple_GET_SIZE(PyObject* items)
    PyObject* PyTuple_GET_ITEM(PyObject* items, Py_ssize_t index)

cdef enum:
    MAX_COVARIANCE = 36     # numbers, of a pose or a twist

cnp.import_array()
load_layouts()
globals()["Transform"] = _TransformMessage  # for hints; in the code, it is a struct

cdef Layout point_layout = Layout(Point, ("x", "y", "z"))
cdef Layout point32_layout = Layout(Point32, ("x", "y", "z"))
cdef Layout vector3_layout = Layout(Vector3, ("x", "y", "z"))
cdef Layout quaternion_layout = Layout(Quaternion, ("x", "y", "z", "w"))
cdef Layout pose_layout = Layout(Pose, ("position", "orientation"))


cdef _type_error(Layout layout, object message, Exception reason):
    kind = _MalformedObjectError if isinstance(reason, AttributeError) else TypeError
    cls = layout.message_class
    name = f"{cls.__module__.partition('.')[0]}/{cls.__name__}"
    got = type(message).__name__
    advice = ""
    if isinstance(message, (type, property)):  # a field of a class is a property
        got = "a class"
        advice = "; pass a message, not its class"
    elif got == f"{cls.__name__}Stamped":
        advice = "; use the function whose name ends in _stamped"
    return kind(f"expected a {name} or an object with its fields, got {got}: {reason}{advice}")


cdef int _index_of(Layout layout, str name) except -1:
    # Python interns names across modules, so equal names are nearly always the same object.
    cdef PyObject* fields = <PyObject*>layout.fields
    cdef Py_ssize_t i
    for i in range(PyTuple_GET_SIZE(fields)):
        if PyTuple_GET_ITEM(fields, i) == <PyObject*>name:
            return i
    if name not in layout.fields:
        raise LookupError(f"the layout of {layout.message_class.__name__} has no field {name!r}")
    return layout.fields.index(name)


cdef object get_field(Layout layout, object message, str name):
    cdef PyObject* value = layout.peek(message, _index_of(layout, name))
    return <object>value if value != NULL else _get_attribute(layout, message, name)


cdef object _get_attribute(Layout layout, object message, str name):
    try:
        return getattr(message, name)
    except AttributeError as missing:
        raise _type_error(layout, message, missing) from None


cdef int set_field(Layout layout, object message, str name, object value) except -1:
    return layout.put(message, _index_of(layout, name), value)


cdef int read_doubles(Layout layout, object message, double* out, int count) except -1:
    cdef PyObject* value
    cdef int i
    for i in range(count):
        value = layout.peek(message, i)
        if value == NULL or not PyFloat_CheckExact(<object>value):
            return _read_numbers(layout, message, out, count)
        out[i] = PyFloat_AS_DOUBLE(<object>value)
    return 0


cdef int _read_numbers(Layout layout, object message, double* out, int count) except -1:
    try:
        return layout.get_doubles(message, out, count)
    except (AttributeError, TypeError) as missing:
        raise _type_error(layout, message, missing) from None


cdef int read_orientation(object quaternion, double* out, str field) except -1:
    read_doubles(quaternion_layout, quaternion, out, 4)
    if out[0] == 0.0 and out[1] == 0.0 and out[2] == 0.0 and out[3] == 0.0:
        out[3] = 1.0
    elif not quaternion_normalize_any(out):
        raise ValueError(f"{field}: expected finite numbers, got {(out[0], out[1], out[2], out[3])}")
    return 0


cdef int _read_covariance(object covariance, int side, double* out) except -1:
    cdef cnp.ndarray values
    cdef int count = side * side
    if not (cnp.PyArray_CheckExact(covariance) and cnp.PyArray_TYPE(covariance) == cnp.NPY_DOUBLE
            and cnp.PyArray_ISCARRAY_RO(covariance)):
        try:
            covariance = np.asarray(covariance, dtype=np.float64, order="C")
        except (TypeError, ValueError) as reason:
            raise TypeError(f"covariance: expected {count} numbers: {reason}") from None
    values = covariance
    if cnp.PyArray_NDIM(values) == 0:
        raise TypeError(f"covariance: expected {count} numbers, got one value")
    if cnp.PyArray_SIZE(values) != count:
        raise ValueError(f"covariance: expected {count} numbers, got {cnp.PyArray_SIZE(values)}")
    memcpy(out, cnp.PyArray_DATA(values), count * sizeof(double))
    return 0


cdef object copy_shallow(Layout layout, object message):
    cdef PyObject* value
    cdef int i
    copy = layout.new()
    for i, name in enumerate(layout.fields):
        value = layout.peek(message, i)
        layout.put(copy, i, <object>value if value != NULL else _get_attribute(layout, message, name))
    return copy


cdef object _frame_id_of(object header):
    frame_id = get_field(header_layout, header, "frame_id")
    if not PyUnicode_Check(frame_id):
        raise TypeError(f"frame_id: expected a str, got {type(frame_id).__name__}")
    return frame_id


cdef object target_frame(object transform):
    return _frame_id_of(get_field(transform_stamped_layout, transform, "header"))


cdef object target_header(object transform):
    header = get_field(transform_stamped_layout, transform, "header")
    stamp_ns = nanoseconds(get_field(header_layout, header, "stamp"), "header.stamp")
    return new_header(stamp_ns, _frame_id_of(header))


cdef object new_orientation(const double* q):
    cdef double negated[4]
    if q[3] >= 0.0:
        return quaternion_layout.new_doubles(q, 4)
    negated[0] = -q[0]
    negated[1] = -q[1]
    negated[2] = -q[2]
    negated[3] = -q[3]
    return quaternion_layout.new_doubles(negated, 4)


cdef object _new_covariance(const double* values, int side):
    cdef cnp.npy_intp count = side * side
    array = cnp.PyArray_SimpleNew(1, &count, cnp.NPY_DOUBLE)
    memcpy(cnp.PyArray_DATA(array), values, count * sizeof(double))
    return array


cdef object copied_covariance(object covariance, int side):
    cdef double values[MAX_COVARIANCE]
    _read_covariance(covariance, side, values)
    return _new_covariance(values, side)


# Points, vectors, poses, rotations and transforms.

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


# What is done with the content of a message.
ctypedef object (*Move)(object content, const Transform* transform)


cdef object _moved(object content, object transform, Move move):
    cdef Transform tf
    read_transform(transform, &tf)
    return move(content, &tf)


cdef object _moved_stamped(Layout layout, str name, object message, object transform, Move move):
    # The same for the field `name` of a message that has a header, too.
    cdef Transform tf
    read_transform(transform, &tf)
    return stamped(layout, name, move(get_field(layout, message, name), &tf), transform)


cdef object _point_moved(Layout layout, object point, const Transform* transform):
    cdef double xyz[3]
    cdef int i
    read_doubles(layout, point, xyz, 3)
    vector_rotate(transform.rotation, xyz, xyz)
    for i in range(3):
        xyz[i] += transform.translation[i]
    return layout.new_doubles(xyz, 3)


cdef object _transformed_point(object point, const Transform* transform):
    return _point_moved(point_layout, point, transform)


cdef object _transformed_point32(object point, const Transform* transform):
    return _point_moved(point32_layout, point, transform)


cdef object rotated_vector(object vector, const Transform* transform):
    cdef double xyz[3]
    read_doubles(vector3_layout, vector, xyz, 3)
    vector_rotate(transform.rotation, xyz, xyz)
    return vector3_layout.new_doubles(xyz, 3)


cdef object _composed(Layout layout, object old, const Transform* transform, str place, Layout place_layout,
                      str turn):
    # A message of two fields: the `place` of a frame, and its `turn`.
    cdef Transform result
    read_doubles(place_layout, get_field(layout, old, place), result.translation, 3)
    read_orientation(get_field(layout, old, turn), result.rotation, turn)
    transform_compose(transform, &result, &result)
    message = layout.new()
    set_field(layout, message, place, place_layout.new_doubles(result.translation, 3))
    set_field(layout, message, turn, new_orientation(result.rotation))
    return message


cdef object transformed_pose(object pose, const Transform* transform):
    return _composed(pose_layout, pose, transform, "position", point_layout, "orientation")


cdef object _composed_transform(object content, const Transform* transform):
    return _composed(transform_layout, content, transform, "translation", vector3_layout, "rotation")


cdef object transformed_pose_with_covariance(object pose, const Transform* transform):
    cdef Layout layout = pose_with_covariance_layout
    message = layout.new()
    set_field(layout, message, "pose", transformed_pose(get_field(layout, pose, "pose"), transform))
    covariance = get_field(layout, pose, "covariance")
    set_field(layout, message, "covariance", _rotated_covariance(covariance, transform))
    return message


cdef void _sandwich(const double* r, const double* c, double* out) noexcept nogil:
    # out = r c r^T, of 3x3 matrices, row by row.
    cdef double half[9]
    cdef int i, j
    for i in range(3):
        for j in range(3):
            half[3 * i + j] = r[3 * i] * c[j] + r[3 * i + 1] * c[3 + j] + r[3 * i + 2] * c[6 + j]
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = (
                half[3 * i] * r[3 * j] + half[3 * i + 1] * r[3 * j + 1] + half[3 * i + 2] * r[3 * j + 2]
            )


cdef void _rotate_blocks(const double* r, const double* c, int side, double* out) noexcept nogil:
    # Each 3x3 block b of the `side` x `side` matrix c becomes r b r^T. Rounding must not cost the symmetry
    # that filters rely on. r b r^T and (r b^T r^T)^T are equal except for rounding; with their mean, the
    # result of a transposed block is the transposed result, bit by bit.
    cdef double block[9]
    cdef double transposed[9]
    cdef double straight[9]
    cdef double mirrored[9]
    cdef int row, column, i, j
    for row in range(0, side, 3):
        for column in range(0, side, 3):
            for i in range(3):
                for j in range(3):
                    block[3 * i + j] = c[side * (row + i) + column + j]
                    transposed[3 * j + i] = block[3 * i + j]
            _sandwich(r, block, straight)
            _sandwich(r, transposed, mirrored)
            for i in range(3):
                for j in range(3):
                    out[side * (row + i) + column + j] = 0.5 * straight[3 * i + j] + 0.5 * mirrored[3 * j + i]


cdef object rotated_covariance(object covariance, int side, const Transform* transform, bint may_be_absent):
    cdef double values[MAX_COVARIANCE]
    cdef double rotated[MAX_COVARIANCE]
    cdef double matrix[9]
    _read_covariance(covariance, side, values)
    if may_be_absent and values[0] == -1.0:
        return _new_covariance(values, side)
    matrix_from_quaternion(transform.rotation, matrix)
    _rotate_blocks(matrix, values, side, rotated)
    return _new_covariance(rotated, side)


cdef object _rotated_covariance(object covariance, const Transform* transform):
    return rotated_covariance(covariance, 6, transform, False)


cdef object _rotated_quaternion(object quaternion, const Transform* transform):
    cdef double q[4]
    read_orientation(quaternion, q, "quaternion")
    quaternion_multiply(transform.rotation, q, q)
    return new_orientation(q)


cdef bint _has_axes(object message):
    # A quaternion has x, y and z, too, but is not a vector.
    return hasattr(message, "x") and not hasattr(message, "w")


def transform_covariance(
    cov_in: list[float] | np.ndarray, transform: TransformStamped | Transform
) -> np.ndarray:
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
    return _moved(cov_in, transform, _rotated_covariance)


def do_transform_point(
    point: PointStamped | Point | Point32, transform: TransformStamped | Transform
) -> PointStamped | Point | Point32:
    """
    Transform a point from the child frame of ``transform`` to its parent frame: p' = R p + t.

    :param point: a PointStamped, Point or Point32, meters.
    :param transform: a TransformStamped; for a point without a header also a Transform; meters.
    :return: a new message of the same class; its header, if any, has the transform's frame and stamp.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: a rotation is not finite. Coordinates may be NaN or infinite.
    """
    if type(point) is point_stamped_layout.message_class or not _has_axes(point):
        return _moved_stamped(point_stamped_layout, "point", point, transform, _transformed_point)
    if isinstance(point, point32_layout.message_class):
        return _moved(point, transform, _transformed_point32)
    return _moved(point, transform, _transformed_point)


def do_transform_vector3(
    vector3: Vector3Stamped | Vector3, transform: TransformStamped | Transform
) -> Vector3Stamped | Vector3:
    """
    Rotate a vector from the child frame of ``transform`` to its parent frame: v' = R v.

    The translation has no effect.

    :param vector3: a Vector3Stamped or Vector3, of any unit.
    :param transform: a TransformStamped; for a Vector3 also a Transform.
    :return: a new message of the same class; its header, if any, has the transform's frame and stamp.
    :raises TypeError, ValueError: as ``do_transform_point``.
    """
    if type(vector3) is vector3_stamped_layout.message_class or not _has_axes(vector3):
        return _moved_stamped(vector3_stamped_layout, "vector", vector3, transform, rotated_vector)
    return _moved(vector3, transform, rotated_vector)


def do_transform_quaternion(quaternion: Quaternion, transform: TransformStamped | Transform) -> Quaternion:
    """
    Rotate an orientation from the child frame of ``transform`` to its parent frame: q' = r q.

    :param quaternion: a Quaternion of any length; zero length means no rotation.
    :param transform: a TransformStamped or Transform.
    :return: a new Quaternion of length one with w >= 0.
    :raises TypeError, ValueError: as ``do_transform_point``.
    """
    return _moved(quaternion, transform, _rotated_quaternion)


def do_transform_quaternion_stamped(
    quaternion: QuaternionStamped, transform: TransformStamped
) -> QuaternionStamped:
    """
    Rotate an orientation, as ``do_transform_quaternion`` does; the result has the transform's frame and
    stamp.
    """
    return _moved_stamped(quaternion_stamped_layout, "quaternion", quaternion, transform, _rotated_quaternion)


def do_transform_pose(pose: Pose, transform: TransformStamped | Transform) -> Pose:
    """
    Transform a pose from the child frame of ``transform`` to its parent frame: p' = R p + t, q' = r q.

    :param pose: a Pose, meters; its orientation of any length; zero length means no rotation.
    :param transform: a TransformStamped or Transform, meters.
    :return: a new Pose; its orientation has length one and w >= 0.
    :raises TypeError, ValueError: as ``do_transform_point``.
    """
    return _moved(pose, transform, transformed_pose)


def do_transform_pose_stamped(pose: PoseStamped, transform: TransformStamped) -> PoseStamped:
    """Transform a pose, as ``do_transform_pose`` does; the result has the transform's frame and stamp."""
    return _moved_stamped(pose_stamped_layout, "pose", pose, transform, transformed_pose)


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
    return _moved(pose, transform, transformed_pose_with_covariance)


def do_transform_pose_with_covariance_stamped(
    pose: PoseWithCovarianceStamped, transform: TransformStamped
) -> PoseWithCovarianceStamped:
    """
    Transform a pose and its covariance, as ``do_transform_pose_with_covariance`` does; the result has the
    transform's frame and stamp.
    """
    cdef Layout layout = pose_with_covariance_stamped_layout
    return _moved_stamped(layout, "pose", pose, transform, transformed_pose_with_covariance)


def do_transform_transform(content: Transform, transform: TransformStamped | Transform) -> Transform:
    """
    Carry a transform from the child frame of ``transform`` to its parent frame: T' = T_transform T_content.

    :param content: a Transform, meters.
    :param transform: a TransformStamped or Transform, meters.
    :return: a new Transform; its rotation has length one and w >= 0.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: a rotation is not finite.
    """
    return _moved(content, transform, _composed_transform)


def do_transform_transform_stamped(
    content: TransformStamped, transform: TransformStamped
) -> TransformStamped:
    """
    Compose two transforms, as ``do_transform_transform`` does; the result has the frame and stamp of
    ``transform`` and the child of ``content``.
    """
    cdef Layout layout = transform_stamped_layout
    message = _moved_stamped(layout, "transform", content, transform, _composed_transform)
    set_field(layout, message, "child_frame_id", get_field(layout, content, "child_frame_id"))
    return message


# Lists of points and poses, in one pass each.

cdef Layout polygon_layout = Layout(Polygon, ("points",))
cdef Layout polygon_stamped_layout = Layout(PolygonStamped, ("header", "polygon"))
cdef Layout pose_array_layout = Layout(PoseArray, ("header", "poses"))


cdef object _transformed_polygon(object polygon, const Transform* transform):
    corners = get_field(polygon_layout, polygon, "points")
    points = [_transformed_point32(point, transform) for point in corners]
    message = polygon_layout.new()
    set_field(polygon_layout, message, "points", points)
    return message


cdef object _transformed_poses(object poses, const Transform* transform):
    cdef list done = []
    try:
        for pose in poses:
            done.append(transformed_pose(pose, transform))
    except ValueError as error:
        raise ValueError(f"poses[{len(done)}]: {error}") from None
    return done


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
    return _moved(polygon, transform, _transformed_polygon)


def do_transform_polygon_stamped(polygon: PolygonStamped, transform: TransformStamped) -> PolygonStamped:
    """
    Transform each point of a polygon, as ``do_transform_polygon`` does; the result has the transform's frame
    and stamp.
    """
    return _moved_stamped(polygon_stamped_layout, "polygon", polygon, transform, _transformed_polygon)


def do_transform_pose_array(poses: PoseArray, transform: TransformStamped) -> PoseArray:
    """
    Transform each pose of an array, as ``do_transform_pose`` does; the result has the transform's frame and
    stamp.
    """
    return _moved_stamped(pose_array_layout, "poses", poses, transform, _transformed_poses)


# Wrenches, velocities, twists and accelerations.

cdef Layout wrench_layout = Layout(Wrench, ("force", "torque"))
cdef Layout wrench_stamped_layout = Layout(WrenchStamped, ("header", "wrench"))
cdef Layout twist_layout = Layout(Twist, ("linear", "angular"))
cdef Layout twist_stamped_layout = Layout(TwistStamped, ("header", "twist"))
cdef Layout accel_layout = Layout(Accel, ("linear", "angular"))
cdef Layout accel_stamped_layout = Layout(AccelStamped, ("header", "accel"))
cdef Layout velocity_stamped_layout = Layout(
    VelocityStamped, ("header", "body_frame_id", "reference_frame_id", "velocity")
)


cdef object _moved_pair(Layout layout, object pair, const Transform* transform, str line, str lever):
    # A message of two vectors. The field `line` is a vector along a line through a point (force, angular
    # velocity). Seen from the origin of the new frame, it adds t x itself to the other vector, `lever`.
    cdef double a[3]
    cdef double b[3]
    read_doubles(vector3_layout, get_field(layout, pair, line), a, 3)
    read_doubles(vector3_layout, get_field(layout, pair, lever), b, 3)
    vector_rotate(transform.rotation, a, a)
    vector_rotate(transform.rotation, b, b)
    b[0] += transform.translation[1] * a[2] - transform.translation[2] * a[1]
    b[1] += transform.translation[2] * a[0] - transform.translation[0] * a[2]
    b[2] += transform.translation[0] * a[1] - transform.translation[1] * a[0]
    message = layout.new()
    set_field(layout, message, line, vector3_layout.new_doubles(a, 3))
    set_field(layout, message, lever, vector3_layout.new_doubles(b, 3))
    return message


cdef object _moved_wrench(object wrench, const Transform* transform):
    return _moved_pair(wrench_layout, wrench, transform, "force", "torque")


cdef object _moved_velocity(object twist, const Transform* transform):
    return _moved_pair(twist_layout, twist, transform, "angular", "linear")


cdef object _rotated_twist(object twist, const Transform* transform):
    return _rotated_pair(twist_layout, twist, transform)


cdef object _rotated_accel(object accel, const Transform* transform):
    return _rotated_pair(accel_layout, accel, transform)


cdef object _rotated_pair(Layout layout, object pair, const Transform* transform):
    linear = get_field(layout, pair, "linear")
    angular = get_field(layout, pair, "angular")
    message = layout.new()
    set_field(layout, message, "linear", rotated_vector(linear, transform))
    set_field(layout, message, "angular", rotated_vector(angular, transform))
    return message


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
    return _moved(wrench, transform, _moved_wrench)


def do_transform_wrench_stamped(wrench: WrenchStamped, transform: TransformStamped) -> WrenchStamped:
    """Transform a wrench, as ``do_transform_wrench`` does; the result has the transform's frame and stamp."""
    return _moved_stamped(wrench_stamped_layout, "wrench", wrench, transform, _moved_wrench)


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
    cdef Layout layout = velocity_stamped_layout
    message = _moved_stamped(layout, "velocity", velocity, transform, _moved_velocity)
    for name in ("body_frame_id", "reference_frame_id"):
        set_field(layout, message, name, get_field(layout, velocity, name))
    return message


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
    return _moved_stamped(twist_stamped_layout, "twist", twist, transform, _rotated_twist)


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
    return _moved_stamped(accel_stamped_layout, "accel", accel, transform, _rotated_accel)
