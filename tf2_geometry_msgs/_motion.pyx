"""Owns transforming wrenches, velocities, twists and accelerations of geometry_msgs."""

from tf2_geometry_msgs._parts cimport get_field, read_doubles, set_field, target_header, vector3_layout
from tf2_geometry_msgs._transform cimport rotated_vector, stamped
from tf2_py._internal cimport Layout, Transform, read_transform, vector_rotate

from geometry_msgs.msg import (
    Accel,
    AccelStamped,
    Twist,
    TwistStamped,
    VelocityStamped,
    Wrench,
    WrenchStamped,
)

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
    # A message of two vectors, of which that of the field `line` belongs to a line through a point (force,
    # angular velocity); seen from the new frame's origin it adds t x itself to the other, the field `lever`.
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


cdef object _rotated_pair(Layout layout, object pair, const Transform* transform):
    # Of a Twist or an Accel.
    linear = get_field(layout, pair, "linear")
    angular = get_field(layout, pair, "angular")
    message = layout.new()
    set_field(layout, message, "linear", rotated_vector(linear, transform))
    set_field(layout, message, "angular", rotated_vector(angular, transform))
    return message


def do_transform_wrench(wrench: Wrench, transform: TransformStamped | Transform) -> Wrench:
    """
    Transform a wrench from the child frame of ``transform`` to its parent frame.

    From the origin of the one to that of the other: f' = R f, torque' = R torque + t x f'.

    Both vectors are rotated; the lever arm counts: the force, which acted at the old frame's origin (at t in
    the new frame), adds its torque about the new one.
    Formula: K. M. Lynch and F. C. Park, Modern Robotics, 2017, section 3.4 (the wrench's adjoint).

    :param wrench: a Wrench, newtons and newton metres.
    :param transform: a TransformStamped or Transform, metres.
    :return: a new Wrench.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    return _moved_pair(wrench_layout, wrench, &tf, "force", "torque")


def do_transform_wrench_stamped(wrench: WrenchStamped, transform: TransformStamped) -> WrenchStamped:
    """
    Transform a wrench, as ``do_transform_wrench`` does.

    :param wrench: a WrenchStamped, newtons and newton metres.
    :param transform: a TransformStamped, metres.
    :return: a new WrenchStamped with the transform's frame and stamp.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    content = get_field(wrench_stamped_layout, wrench, "wrench")
    content = _moved_pair(wrench_layout, content, &tf, "force", "torque")
    return stamped(wrench_stamped_layout, "wrench", content, transform)


def do_transform_velocity_stamped(velocity: VelocityStamped, transform: TransformStamped) -> VelocityStamped:
    """
    Transform a rigid body's velocity from the child frame of ``transform`` to its parent frame.

    From the origin of the one to that of the other: w' = R w, v' = R v + t x w'.

    Both vectors are rotated; the lever arm counts: v' is the velocity of the body's point that lies at the
    new frame's origin. The two frames are taken to be at rest to each other. The tf2 of Jazzy adds the
    unrotated input to this and keeps the old header; later ones do not add it.
    Formula: K. M. Lynch and F. C. Park, Modern Robotics, 2017, equation 3.83 (the twist's adjoint).

    :param velocity: a VelocityStamped, metres and radians per second.
    :param transform: a TransformStamped, metres.
    :return: a new VelocityStamped with the transform's frame and stamp, and the frames that ``velocity``
        names.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    cdef Layout layout = velocity_stamped_layout
    read_transform(transform, &tf)
    message = layout.new()
    set_field(layout, message, "header", target_header(transform))
    set_field(layout, message, "body_frame_id", get_field(layout, velocity, "body_frame_id"))
    set_field(layout, message, "reference_frame_id", get_field(layout, velocity, "reference_frame_id"))
    twist = get_field(layout, velocity, "velocity")
    set_field(layout, message, "velocity", _moved_pair(twist_layout, twist, &tf, "angular", "linear"))
    return message


def do_transform_twist_stamped(twist: TwistStamped, transform: TransformStamped) -> TwistStamped:
    """
    Rotate a twist from the child frame of ``transform`` to its parent frame: v' = R v, w' = R w.

    Both vectors are rotated; the lever arm does not count: v' is still the velocity of the old point, in new
    axes. ``do_transform_velocity_stamped`` moves the point too.

    :param twist: a TwistStamped, metres and radians per second.
    :param transform: a TransformStamped.
    :return: a new TwistStamped with the transform's frame and stamp.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    content = _rotated_pair(twist_layout, get_field(twist_stamped_layout, twist, "twist"), &tf)
    return stamped(twist_stamped_layout, "twist", content, transform)


def do_transform_accel_stamped(accel: AccelStamped, transform: TransformStamped) -> AccelStamped:
    """
    Rotate an acceleration from the child frame of ``transform`` to its parent frame: a' = R a.

    Both vectors are rotated. The lever arm does not count: the linear part is still the acceleration of the
    old point, in new axes. To move the point would take the angular velocity, which the message does not
    hold.

    :param accel: an AccelStamped, metres and radians per second squared.
    :param transform: a TransformStamped.
    :return: a new AccelStamped with the transform's frame and stamp.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    content = _rotated_pair(accel_layout, get_field(accel_stamped_layout, accel, "accel"), &tf)
    return stamped(accel_stamped_layout, "accel", content, transform)
