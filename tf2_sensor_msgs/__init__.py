"""The types of sensor_msgs carried from frame to frame."""

# Public programs take message classes from here; they stay outside __all__.
from sensor_msgs.msg import Imu, MagneticField, PointCloud2  # noqa: F401

from tf2_sensor_msgs.tf2_sensor_msgs import *  # noqa: F403
from tf2_sensor_msgs.tf2_sensor_msgs import __all__ as __all__
