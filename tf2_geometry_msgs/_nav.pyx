# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transform the types of nav_msgs. Importing this module needs nav_msgs."""

from tf2_geometry_msgs._geometry cimport (
    copied_covariance,
    get_field,
    pose_stamped_layout,
    read_doubles,
    set_field,
    stamped,
    target_frame,
    target_header,
    transformed_pose,
    transformed_pose_with_covariance,
    vector3_layout,
)
from tf2_py._internal cimport Layout, Transform, header_layout, nanoseconds, new_header, read_transform

from geometry_msgs.msg import TransformStamped, Twist, TwistWithCovariance
from nav_msgs.msg import Odometry, Path

cdef Layout path_layout = Layout(Path, ("header", "poses"))
cdef Layout odometry_layout = Layout(Odometry, ("header", "child_frame_id", "pose", "twist"))
cdef Layout twist_with_covariance_layout = Layout(TwistWithCovariance, ("twist", "covariance"))
cdef Layout twist_layout = Layout(Twist, ("linear", "angular"))


cdef object _transformed_step(object step, const Transform* transform, object path_frame, object new_frame):
    # A pose of a path keeps its own stamp: the time at which it is to be reached.
    header = get_field(pose_stamped_layout, step, "header")
    frame = get_field(header_layout, header, "frame_id")
    if frame and path_frame and frame != path_frame:
        wanted = f"expected the frame of the path, {path_frame!r}, or no frame for each pose"
        raise ValueError(f"{wanted}, got {frame!r}")
    message = pose_stamped_layout.new()
    stamp_ns = nanoseconds(get_field(header_layout, header, "stamp"), "header.stamp")
    set_field(pose_stamped_layout, message, "header", new_header(stamp_ns, new_frame))
    pose = get_field(pose_stamped_layout, step, "pose")
    set_field(pose_stamped_layout, message, "pose", transformed_pose(pose, transform))
    return message


cdef object _copied_twist(object content):
    # A copy, so that changing one message does not change the other.
    cdef double vector[3]
    pair = get_field(twist_with_covariance_layout, content, "twist")
    twist = twist_layout.new()
    for name in twist_layout.fields:
        read_doubles(vector3_layout, get_field(twist_layout, pair, name), vector, 3)
        set_field(twist_layout, twist, name, vector3_layout.new_doubles(vector, 3))
    covariance = copied_covariance(get_field(twist_with_covariance_layout, content, "covariance"), 6)
    message = twist_with_covariance_layout.new()
    set_field(twist_with_covariance_layout, message, "twist", twist)
    set_field(twist_with_covariance_layout, message, "covariance", covariance)
    return message


def do_transform_path(path: Path, transform: TransformStamped) -> Path:
    """
    Transform each pose of a path from the child frame of ``transform`` to its parent frame.

    :param path: a Path, meters; its poses may leave their frame empty.
    :param transform: a TransformStamped, meters.
    :return: a new Path with the transform's frame and stamp; its poses have that frame and keep their stamps.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: a pose has a frame other than the path's, or a rotation is not finite.
    """
    cdef Transform tf
    cdef list content = []
    read_transform(transform, &tf)
    path_frame = get_field(header_layout, get_field(path_layout, path, "header"), "frame_id")
    new_frame = target_frame(transform)
    poses = get_field(path_layout, path, "poses")
    try:
        for step in poses:
            content.append(_transformed_step(step, &tf, path_frame, new_frame))
    except ValueError as error:
        raise ValueError(f"poses[{len(content)}]: {error}") from None
    return stamped(path_layout, "poses", content, transform)


def do_transform_odometry(odometry: Odometry, transform: TransformStamped) -> Odometry:
    """
    Transform the pose of an Odometry from the child frame of ``transform`` to its parent frame.

    The twist is given in the axes of ``child_frame_id``, so it does not depend on the frame of the header.

    :param odometry: an Odometry, meters, radians and seconds.
    :param transform: a TransformStamped, meters.
    :return: a new Odometry with the transform's frame and stamp.
    :raises TypeError: an argument has another type. If it lacks a field, the error is also an AttributeError.
    :raises ValueError: a covariance is not 36 numbers, or a rotation is not finite.
    """
    cdef Transform tf
    cdef Layout layout = odometry_layout
    read_transform(transform, &tf)
    message = layout.new()
    set_field(layout, message, "header", target_header(transform))
    set_field(layout, message, "child_frame_id", get_field(layout, odometry, "child_frame_id"))
    set_field(
        layout, message, "pose", transformed_pose_with_covariance(get_field(layout, odometry, "pose"), &tf)
    )
    set_field(layout, message, "twist", _copied_twist(get_field(layout, odometry, "twist")))
    return message
