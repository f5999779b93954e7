"""Owns carrying wrenches, velocities, twists and accelerations of geometry_msgs into another frame."""

from tf2_geometry_msgs._parts cimport part, read_doubles, target_header, vector3_layout
from tf2_geometry_msgs._transform cimport carried_vector, stamped
from tf2_py._core.geometry cimport vector_rotate
from tf2_py._core.types cimport Transform
from tf2_py._objects.messages cimport Layout, read_transform

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


cdef object _pair(Layout layout, object first, object second):
    message = layout.new()
    layout.put(message, 0, first)
    layout.put(message, 1, second)
    return message


cdef object _carried_pair(Layout layout, object pair, const Transform* transform, int line, int lever):
    # A message of two vectors, of which the one at index `line` belongs to a line through a point (force,
    # angular velocity); seen from the new frame's origin it adds t x itself to the other, at index `lever`.
    cdef double vectors[2][3]
    cdef double* a = vectors[line]
    cdef double* b = vectors[lever]
    cdef int i
    for i in range(2):
        read_doubles(vector3_layout, part(layout, pair, i), vectors[i], 3)
        vector_rotate(transform.rotation, vectors[i], vectors[i])
    b[0] += transform.translation[1] * a[2] - transform.translation[2] * a[1]
    b[1] += transform.translation[2] * a[0] - transform.translation[0] * a[2]
    b[2] += transform.translation[0] * a[1] - transform.translation[1] * a[0]
    return _pair(layout, vector3_layout.new_doubles(vectors[0], 3), vector3_layout.new_doubles(vectors[1], 3))


cdef object _turned_pair(Layout layout, object pair, const Transform* transform):
    return _pair(
        layout,
        carried_vector(part(layout, pair, 0), transform),
        carried_vector(part(layout, pair, 1), transform),
    )


def do_transform_wrench(wrench, transform):
    """Carry a wrench from one frame's origin to another's: f' = R f, torque' = R torque + t x f'.

    Both vectors are rotated; the lever arm counts: the force, which acted at the old frame's origin (at t in
    the new frame), adds its torque about the new one.
    Formula: K. M. Lynch and F. C. Park, Modern Robotics, 2017, section 3.4 (the wrench's adjoint).

    :param wrench: a Wrench, newtons and newton metres
    :param transform: a TransformStamped or Transform
    :returns: a new Wrench
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    read_transform(transform, &by)
    return _carried_pair(wrench_layout, wrench, &by, 0, 1)


def do_transform_wrench_stamped(wrench, transform):
    """`do_transform_wrench` for a WrenchStamped and a TransformStamped.

    :returns: a new WrenchStamped with the transform's frame and stamp
    """
    cdef Transform by
    read_transform(transform, &by)
    content = _carried_pair(wrench_layout, part(wrench_stamped_layout, wrench, 1), &by, 0, 1)
    return stamped(wrench_stamped_layout, content, transform)


def do_transform_velocity_stamped(velocity, transform):
    """Carry a rigid body's velocity from one frame's origin to another's: w' = R w, v' = R v + t x w'.

    Both vectors are rotated; the lever arm counts: v' is the velocity of the body's point that lies at the
    new frame's origin. The two frames are taken to be at rest to each other. The tf2 of Jazzy adds the
    unrotated input to this and keeps the old header; later ones do not add it.
    Formula: K. M. Lynch and F. C. Park, Modern Robotics, 2017, equation 3.83 (the twist's adjoint).

    :param velocity: a VelocityStamped, metres and radians per second
    :param transform: a TransformStamped
    :returns: a new VelocityStamped with the transform's frame and stamp, and the frames that `velocity` names
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    cdef Layout layout = velocity_stamped_layout
    cdef int i
    read_transform(transform, &by)
    message = layout.new()
    layout.put(message, 0, target_header(transform))
    for i in range(1, 3):
        layout.put(message, i, part(layout, velocity, i))
    layout.put(message, 3, _carried_pair(twist_layout, part(layout, velocity, 3), &by, 1, 0))
    return message


def do_transform_twist_stamped(twist, transform):
    """Turn a twist into the axes of another frame: v' = R v, w' = R w.

    Both vectors are rotated; the lever arm does not count: v' is still the velocity of the old point, in new
    axes. `do_transform_velocity_stamped` moves the point too.

    :param twist: a TwistStamped, metres and radians per second
    :param transform: a TransformStamped
    :returns: a new TwistStamped with the transform's frame and stamp
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    read_transform(transform, &by)
    content = _turned_pair(twist_layout, part(twist_stamped_layout, twist, 1), &by)
    return stamped(twist_stamped_layout, content, transform)


def do_transform_accel_stamped(accel, transform):
    """Turn an acceleration into the axes of another frame: a' = R a, for both its vectors.

    The lever arm does not count: the linear part is still the acceleration of the old point, in new axes.
    To move the point would take the angular velocity, which the message does not hold.

    :param accel: an AccelStamped, metres and radians per second squared
    :param transform: a TransformStamped
    :returns: a new AccelStamped with the transform's frame and stamp
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    read_transform(transform, &by)
    content = _turned_pair(accel_layout, part(accel_stamped_layout, accel, 1), &by)
    return stamped(accel_stamped_layout, content, transform)
