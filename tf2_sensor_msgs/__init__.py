"""The types of sensor_msgs carried from frame to frame."""

# Public programs take message classes from here; they stay outside __all__.
from sensor_msgs.msg import Imu, MagneticField, PointCloud2  # noqa: F401

from tf2_sensor_msgs.tf2_sensor_msgs import do_transform_cloud, transform_points
from tf2_sensor_msgs.tf2_sensor_msgs import do_transform_imu as do_transform_imu
from tf2_sensor_msgs.tf2_sensor_msgs import do_transform_magnetic_field as do_transform_magnetic_field
from tf2_sensor_msgs.tf2_sensor_msgs import from_msg_msg as from_msg_msg
from tf2_sensor_msgs.tf2_sensor_msgs import to_msg_msg as to_msg_msg

# What `import *` gives from tf2's package.
__all__ = ["do_transform_cloud", "transform_points"]
