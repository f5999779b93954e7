"""The types of what tf2 transforms, which programs use as default values and for casts."""

from typing import Union

from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped, Vector3Stamped
from sensor_msgs.msg import PointCloud2

from tf2_ros.buffer_interface import PyKDLType

MsgStamped = Union[PointStamped, PoseStamped, PoseWithCovarianceStamped, Vector3Stamped, PointCloud2]
TransformableObject = Union[MsgStamped, PyKDLType]
