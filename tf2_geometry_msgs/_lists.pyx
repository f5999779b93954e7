"""Owns carrying lists of points and poses of geometry_msgs into another frame, in one pass each."""

from tf2_geometry_msgs._parts cimport get_field, point32_layout, set_field
from tf2_geometry_msgs._transform cimport carried_point, carried_pose, stamped
from tf2_py._core.types cimport Transform
from tf2_py._objects.messages cimport Layout, read_transform

from geometry_msgs.msg import Polygon, PolygonStamped, PoseArray

cdef Layout polygon_layout = Layout(Polygon, ("points",))
cdef Layout polygon_stamped_layout = Layout(PolygonStamped, ("header", "polygon"))
cdef Layout pose_array_layout = Layout(PoseArray, ("header", "poses"))


cdef object _carried_polygon(object polygon, const Transform* transform):
    corners = get_field(polygon_layout, polygon, "points")
    points = [carried_point(point32_layout, point, transform) for point in corners]
    message = polygon_layout.new()
    set_field(polygon_layout, message, "points", points)
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
    content = _carried_polygon(get_field(polygon_stamped_layout, polygon, "polygon"), &by)
    return stamped(polygon_stamped_layout, "polygon", content, transform)


def do_transform_pose_array(poses, transform):
    """Carry each pose of a PoseArray into the frame of a TransformStamped, as `do_transform_pose` does.

    :returns: a new PoseArray with the transform's frame and stamp
    :raises TypeError: for other types
    :raises ValueError: where the transform's rotation is not finite
    """
    cdef Transform by
    read_transform(transform, &by)
    content = [carried_pose(pose, &by) for pose in get_field(pose_array_layout, poses, "poses")]
    return stamped(pose_array_layout, "poses", content, transform)
