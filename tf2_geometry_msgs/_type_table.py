# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The table of the types of geometry_msgs and nav_msgs: which function transforms which."""

from geometry_msgs import msg as geometry

from tf2_geometry_msgs import _geometry
from tf2_ros._registration import TransformFunctions

# A line here registers a type.
TYPES: TransformFunctions = {
    geometry.AccelStamped: _geometry.do_transform_accel_stamped,
    geometry.Point: _geometry.do_transform_point,
    geometry.Point32: _geometry.do_transform_point,
    geometry.PointStamped: _geometry.do_transform_point,
    geometry.Polygon: _geometry.do_transform_polygon,
    geometry.PolygonStamped: _geometry.do_transform_polygon_stamped,
    geometry.Pose: _geometry.do_transform_pose,
    geometry.PoseArray: _geometry.do_transform_pose_array,
    geometry.PoseStamped: _geometry.do_transform_pose_stamped,
    geometry.PoseWithCovariance: _geometry.do_transform_pose_with_covariance,
    geometry.PoseWithCovarianceStamped: _geometry.do_transform_pose_with_covariance_stamped,
    geometry.Quaternion: _geometry.do_transform_quaternion,
    geometry.QuaternionStamped: _geometry.do_transform_quaternion_stamped,
    geometry.Transform: _geometry.do_transform_transform,
    geometry.TransformStamped: _geometry.do_transform_transform_stamped,
    geometry.TwistStamped: _geometry.do_transform_twist_stamped,
    geometry.Vector3: _geometry.do_transform_vector3,
    geometry.Vector3Stamped: _geometry.do_transform_vector3,
    geometry.VelocityStamped: _geometry.do_transform_velocity_stamped,
    geometry.Wrench: _geometry.do_transform_wrench,
    geometry.WrenchStamped: _geometry.do_transform_wrench_stamped,
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
