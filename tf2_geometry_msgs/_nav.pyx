"""Owns carrying the types of nav_msgs into another frame; imports only where that package does."""

from tf2_geometry_msgs._parts cimport (
    new_covariance,
    part,
    read_covariance,
    read_doubles,
    target_frame,
    target_header,
    vector3_layout,
)
from tf2_geometry_msgs._transform cimport (
    carried_pose,
    carried_pose_with_covariance,
    pose_stamped_layout,
    stamped,
)
from tf2_py._core.types cimport Transform
from tf2_py._objects.messages cimport Layout, header_layout, new_header, read_transform, time_to_ns

from geometry_msgs.msg import Twist, TwistWithCovariance
from nav_msgs.msg import Odometry, Path

cdef Layout path_layout = Layout(Path, ("header", "poses"))
cdef Layout odometry_layout = Layout(Odometry, ("header", "child_frame_id", "pose", "twist"))
cdef Layout twist_with_covariance_layout = Layout(TwistWithCovariance, ("twist", "covariance"))
cdef Layout twist_layout = Layout(Twist, ("linear", "angular"))


cdef object _carried_step(object step, const Transform* transform, object path_frame, object new_frame):
    # A pose of a path keeps its own stamp: the time at which it is to be reached.
    header = part(pose_stamped_layout, step, 0)
    frame = part(header_layout, header, 1)
    if frame and path_frame and frame != path_frame:
        raise ValueError(f"a pose of the path is in frame {frame!r}, the path itself in {path_frame!r}")
    message = pose_stamped_layout.new()
    stamp_ns = time_to_ns(part(header_layout, header, 0))
    pose_stamped_layout.put(message, 0, new_header(stamp_ns, new_frame))
    pose_stamped_layout.put(message, 1, carried_pose(part(pose_stamped_layout, step, 1), transform))
    return message


cdef object _copied_twist(object content):
    # So that neither message changes with the other.
    cdef double vector[3]
    cdef double covariance[36]
    cdef int i
    pair = part(twist_with_covariance_layout, content, 0)
    twist = twist_layout.new()
    for i in range(2):
        read_doubles(vector3_layout, part(twist_layout, pair, i), vector, 3)
        twist_layout.put(twist, i, vector3_layout.new_doubles(vector, 3))
    read_covariance(part(twist_with_covariance_layout, content, 1), 6, covariance)
    message = twist_with_covariance_layout.new()
    twist_with_covariance_layout.put(message, 0, twist)
    twist_with_covariance_layout.put(message, 1, new_covariance(covariance, 6))
    return message


def do_transform_path(path, transform):
    """Carry each pose of a path into the frame of a transform, as `do_transform_pose` does.

    :param path: a Path; its poses may leave their frame empty
    :param transform: a TransformStamped
    :returns: a new Path with the transform's frame and stamp; its poses have that frame and keep their stamps
    :raises TypeError: for other types
    :raises ValueError: where a pose names another frame than the path, or the transform's rotation has no
        length
    """
    cdef Transform by
    read_transform(transform, &by)
    path_frame = part(header_layout, part(path_layout, path, 0), 1)
    new_frame = target_frame(transform)
    content = [_carried_step(step, &by, path_frame, new_frame) for step in part(path_layout, path, 1)]
    return stamped(path_layout, content, transform)


def do_transform_odometry(odometry, transform):
    """Carry the pose of an Odometry into the frame of a transform, its covariance too.

    The twist is that of `child_frame_id` in its own axes, which no change of the header's frame touches.

    :param odometry: an Odometry
    :param transform: a TransformStamped
    :returns: a new Odometry with the transform's frame and stamp
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    cdef Layout layout = odometry_layout
    read_transform(transform, &by)
    message = layout.new()
    layout.put(message, 0, target_header(transform))
    layout.put(message, 1, part(layout, odometry, 1))
    layout.put(message, 2, carried_pose_with_covariance(part(layout, odometry, 2), &by))
    layout.put(message, 3, _copied_twist(part(layout, odometry, 3)))
    return message
