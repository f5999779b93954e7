"""The types of geometry_msgs and nav_msgs carried from frame to frame."""

import contextlib

# Public programs take message classes from here; they stay outside __all__.
from geometry_msgs.msg import (  # noqa: F401
    AccelStamped,
    Polygon,
    PoseArray,
    PoseWithCovariance,
    Quaternion,
    QuaternionStamped,
    Transform,
    TwistStamped,
    Vector3,
    VelocityStamped,
    Wrench,
    WrenchStamped,
)

from tf2_geometry_msgs import tf2_geometry_msgs
from tf2_geometry_msgs._lists import do_transform_polygon as do_transform_polygon
from tf2_geometry_msgs._lists import do_transform_pose_array as do_transform_pose_array
from tf2_geometry_msgs._motion import do_transform_accel_stamped as do_transform_accel_stamped
from tf2_geometry_msgs._motion import do_transform_twist_stamped as do_transform_twist_stamped
from tf2_geometry_msgs._motion import do_transform_velocity_stamped as do_transform_velocity_stamped
from tf2_geometry_msgs._motion import do_transform_wrench as do_transform_wrench
from tf2_geometry_msgs._motion import do_transform_wrench_stamped as do_transform_wrench_stamped
from tf2_geometry_msgs._transform import (
    do_transform_pose_with_covariance as do_transform_pose_with_covariance,
)
from tf2_geometry_msgs._transform import do_transform_quaternion as do_transform_quaternion
from tf2_geometry_msgs._transform import do_transform_quaternion_stamped as do_transform_quaternion_stamped
from tf2_geometry_msgs._transform import do_transform_transform as do_transform_transform
from tf2_geometry_msgs._transform import do_transform_transform_stamped as do_transform_transform_stamped
from tf2_geometry_msgs.tf2_geometry_msgs import *  # noqa: F403

with contextlib.suppress(ImportError):  # without nav_msgs they are not there
    from tf2_geometry_msgs.tf2_geometry_msgs import do_transform_odometry as do_transform_odometry
    from tf2_geometry_msgs.tf2_geometry_msgs import do_transform_path as do_transform_path

__all__ = ["tf2_geometry_msgs"]
__all__ += tf2_geometry_msgs.__all__
