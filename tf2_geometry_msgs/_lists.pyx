"""Owns carrying lists of points and poses of geometry_msgs into another frame, in one pass each."""

from tf2_geometry_msgs._parts cimport part, point32_layout
from tf2_geometry_msgs._transform cimport carried_point, carried_pose, stamped
from tf2_py._core.types cimport Transform
from tf2_py._objects.messages cimport Layout, read_transform

from geometry_msgs.msg import Polygon, PolygonStamped, PoseArray

cdef Layout polygon_layout = Layout(Polygon, ("points",))
cdef Layout polygon_stamped_layout = Layout(PolygonStamped, ("header", "polygon"))
cdef Layout pose_array_layout = Layout(PoseArray, ("header", "poses"))


cdef object _carried_polygon(object polygon, const Transform* transform):
    points = [carried_point(point32_layout, point, transform) for point in part(polygon_layout, polygon, 0)]
    message = polygon_layout.new()
    polygon_layout.put(message, 0, points)
    return message


def do_transform_polygon(polygon, transform):
    """Carry each point of a polygon into the frame of a transform: p' = R p + t.

    Computed in double precision; the message's float32 is what goes over the wire.

    :param polygon: a Polygon of any number of Point32, metres
    :param transform: a TransformStamped or Transform
    :returns: a new Polygon
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    read_transform(transform, &by)
    return _carried_polygon(polygon, &by)


def do_transform_polygon_stamped(polygon, transform):
    """`do_transform_polygon` for a PolygonStamped and a TransformStamped.

    :returns: a new PolygonStamped with the transform's frame and stamp
    """
    cdef Transform by
    read_transform(transform, &by)
    content = _carried_polygon(part(polygon_stamped_layout, polygon, 1), &by)
    return stamped(polygon_stamped_layout, content, transform)


def do_transform_pose_array(poses, transform):
    """Carry each pose of a PoseArray into the frame of a TransformStamped, as `do_transform_pose` does.

    :returns: a new PoseArray with the transform's frame and stamp
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    read_transform(transform, &by)
    content = [carried_pose(pose, &by) for pose in part(pose_array_layout, poses, 1)]
    return stamped(pose_array_layout, content, transform)
