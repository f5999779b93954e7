"""Owns what tf2_ros knows of the types of sensor_msgs."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

# Public programs take message classes from here, too.
from geometry_msgs.msg import Transform, TransformStamped
from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured
from sensor_msgs.msg import Imu, MagneticField, PointCloud2
from std_msgs.msg import Header

from tf2_geometry_msgs._affine import _get_mat_from_quat  # noqa: F401  used by programs
from tf2_ros._tf2_names import Union, tf2_ros
from tf2_ros.buffer_interface import ConvertRegistration, TransformRegistration
from tf2_sensor_msgs._cloud import do_transform_cloud
from tf2_sensor_msgs._imu import do_transform_imu, do_transform_magnetic_field
from tf2_sensor_msgs._points import transform_points

if TYPE_CHECKING:
    from tf2_sensor_msgs._point_arrays import create_cloud, read_points

# What `import *` gives from tf2's module, and nothing more: a name of ours could hide one of a program's.
__all__ = [
    "Header",
    "PointCloud2",
    "Transform",
    "TransformStamped",
    "Union",
    "create_cloud",
    "do_transform_cloud",
    "from_msg_msg",
    "np",
    "read_points",
    "structured_to_unstructured",
    "tf2_ros",
    "to_msg_msg",
    "transform_points",
    "unstructured_to_structured",
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


def __getattr__(name: str) -> Any:
    # Nothing here needs them, and sensor_msgs_py takes its time to import.
    if name not in ("create_cloud", "read_points"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        from sensor_msgs_py import point_cloud2 as owner  # type: ignore[import-not-found,unused-ignore]
    except ModuleNotFoundError as missing:
        if missing.name != "sensor_msgs_py":
            raise
        from tf2_sensor_msgs import _point_arrays as owner
    globals()[name] = getattr(owner, name)
    return globals()[name]
