"""Owns the table of the types of geometry_msgs and nav_msgs: which function transforms which."""

from geometry_msgs import msg as geometry

from tf2_geometry_msgs import _lists, _motion, _transform
from tf2_ros._registration import TransformFunctions

# A line here registers a type and gives its class and its function to the package's namespace.
TYPES: TransformFunctions = {
    geometry.AccelStamped: _motion.do_transform_accel_stamped,
    geometry.Point: _transform.do_transform_point,
    geometry.Point32: _transform.do_transform_point,
    geometry.PointStamped: _transform.do_transform_point,
    geometry.Polygon: _lists.do_transform_polygon,
    geometry.PolygonStamped: _lists.do_transform_polygon_stamped,
    geometry.Pose: _transform.do_transform_pose,
    geometry.PoseArray: _lists.do_transform_pose_array,
    geometry.PoseStamped: _transform.do_transform_pose_stamped,
    geometry.PoseWithCovariance: _transform.do_transform_pose_with_covariance,
    geometry.PoseWithCovarianceStamped: _transform.do_transform_pose_with_covariance_stamped,
    geometry.Quaternion: _transform.do_transform_quaternion,
    geometry.QuaternionStamped: _transform.do_transform_quaternion_stamped,
    geometry.Transform: _transform.do_transform_transform,
    geometry.TransformStamped: _transform.do_transform_transform_stamped,
    geometry.TwistStamped: _motion.do_transform_twist_stamped,
    geometry.Vector3: _transform.do_transform_vector3,
    geometry.Vector3Stamped: _transform.do_transform_vector3,
    geometry.VelocityStamped: _motion.do_transform_velocity_stamped,
    geometry.Wrench: _motion.do_transform_wrench,
    geometry.WrenchStamped: _motion.do_transform_wrench_stamped,
}

try:
    from nav_msgs import msg as nav
except ModuleNotFoundError as missing:
    if missing.name != "nav_msgs":
        raise
else:
    from tf2_geometry_msgs import _nav

    TYPES |= {
        nav.Odometry: _nav.do_transform_odometry,
        nav.Path: _nav.do_transform_path,
    }
