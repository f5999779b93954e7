"""Owns what tf2_ros knows of the types of sensor_msgs."""

from collections.abc import Callable
from typing import Any

# Public programs take message classes from here too; they stay outside __all__.
from geometry_msgs.msg import Transform, TransformStamped  # noqa: F401
from sensor_msgs.msg import Imu, MagneticField, PointCloud2

from tf2_ros.buffer_interface import ConvertRegistration, TransformRegistration
from tf2_sensor_msgs._cloud import do_transform_cloud
from tf2_sensor_msgs._imu import do_transform_imu, do_transform_magnetic_field
from tf2_sensor_msgs._points import transform_points

__all__ = [
    "do_transform_cloud",
    "do_transform_imu",
    "do_transform_magnetic_field",
    "from_msg_msg",
    "to_msg_msg",
    "transform_points",
]

_FUNCTIONS: dict[Any, Callable[[Any, Any], Any]] = {
    Imu: do_transform_imu,
    MagneticField: do_transform_magnetic_field,
    PointCloud2: do_transform_cloud,
}


def to_msg_msg(msg: Any) -> Any:
    """Return `msg`, which is a message already."""
    return msg


def from_msg_msg(msg: Any) -> Any:
    """Return `msg`, which is a message already."""
    return msg


for _cls, _function in _FUNCTIONS.items():
    TransformRegistration().add(_cls, _function, default=True)
    ConvertRegistration().add_to_msg(_cls, to_msg_msg, default=True)
    ConvertRegistration().add_from_msg(_cls, from_msg_msg, default=True)
