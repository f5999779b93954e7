"""Owns transforming lists of points and poses of geometry_msgs, in one pass each."""

from tf2_geometry_msgs._parts cimport get_field, point32_layout, set_field
from tf2_geometry_msgs._transform cimport stamped, transformed_point, transformed_pose
from tf2_py._internal cimport Layout, Transform, read_transform

from geometry_msgs.msg import Polygon, PolygonStamped, PoseArray

cdef Layout polygon_layout = Layout(Polygon, ("points",))
cdef Layout polygon_stamped_layout = Layout(PolygonStamped, ("header", "polygon"))
cdef Layout pose_array_layout = Layout(PoseArray, ("header", "poses"))


cdef object _transformed_polygon(object polygon, const Transform* transform):
    corners = get_field(polygon_layout, polygon, "points")
    points = [transformed_point(point32_layout, point, transform) for point in corners]
    message = polygon_layout.new()
    set_field(polygon_layout, message, "points", points)
    return message


def do_transform_polygon(polygon: Polygon, transform: TransformStamped | Transform) -> Polygon:
    """
    Transform each point of a polygon from the child frame of ``transform`` to its parent frame: p' = R p + t.

    In double precision: a new Point32 holds doubles, as every Python message does; it is rounded to float32
    when it is serialised.

    :param polygon: a Polygon of any number of Point32, metres.
    :param transform: a TransformStamped or Transform, metres.
    :return: a new Polygon.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    return _transformed_polygon(polygon, &tf)


def do_transform_polygon_stamped(polygon: PolygonStamped, transform: TransformStamped) -> PolygonStamped:
    """
    Transform each point of a polygon, as ``do_transform_polygon`` does.

    :param polygon: a PolygonStamped, metres.
    :param transform: a TransformStamped, metres.
    :return: a new PolygonStamped with the transform's frame and stamp.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    content = _transformed_polygon(get_field(polygon_stamped_layout, polygon, "polygon"), &tf)
    return stamped(polygon_stamped_layout, "polygon", content, transform)


def do_transform_pose_array(poses: PoseArray, transform: TransformStamped) -> PoseArray:
    """
    Transform each pose of an array, as ``do_transform_pose`` does.

    :param poses: a PoseArray, metres.
    :param transform: a TransformStamped, metres.
    :return: a new PoseArray with the transform's frame and stamp.
    :raises TypeError: an argument is of another type; where it lacks a field, also an AttributeError.
    :raises ValueError: the transform's rotation is not finite.
    """
    cdef Transform tf
    read_transform(transform, &tf)
    content = [transformed_pose(pose, &tf) for pose in get_field(pose_array_layout, poses, "poses")]
    return stamped(pose_array_layout, "poses", content, transform)
