"""Transform messages of sensor_msgs from frame to frame."""

import tf2_ros_cython._requirement  # noqa: F401

from typing import TYPE_CHECKING

from tf2_ros._registration import names_of as _names_of
from tf2_sensor_msgs._deskew import deskew as deskew
from tf2_sensor_msgs._types import TYPES as _TYPES
from tf2_sensor_msgs.tf2_sensor_msgs import do_transform_cloud, transform_points
from tf2_sensor_msgs.tf2_sensor_msgs import from_msg_msg as from_msg_msg
from tf2_sensor_msgs.tf2_sensor_msgs import to_msg_msg as to_msg_msg

if TYPE_CHECKING:  # the table's functions, as their stubs declare them
    from tf2_sensor_msgs._cloud import *  # noqa: F403
    from tf2_sensor_msgs._imu import *  # noqa: F403

# Types that tf2 lacks, and message classes, which public programs take from here, stay outside __all__.
globals().update(_names_of(_TYPES))

# What `import *` imports from tf2's package.
__all__ = ["do_transform_cloud", "transform_points"]
