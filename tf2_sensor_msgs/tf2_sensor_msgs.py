# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The names of tf2's module of this name; importing it registers the types of the table."""

from typing import TYPE_CHECKING, Union

import numpy as np

# Public programs take message classes from here, too.
from geometry_msgs.msg import Transform, TransformStamped
from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

import tf2_ros
from tf2_geometry_msgs._affine import _get_mat_from_quat  # noqa: F401  used by programs
from tf2_ros._registration import from_msg_msg, register_messages, to_msg_msg
from tf2_sensor_msgs._cloud import do_transform_cloud, transform_points
from tf2_sensor_msgs._type_table import TYPES

# What `import *` imports from tf2's module, and nothing more: our own names could hide those of a program.
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

register_messages(TYPES)

if TYPE_CHECKING:
    from tf2_sensor_msgs._point_cloud2_standin import create_cloud, read_points
else:

    def __getattr__(name):
        # Imported on demand, because sensor_msgs_py is slow to import.
        if name not in ("create_cloud", "read_points"):
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        try:
            from sensor_msgs_py import point_cloud2 as owner
        except ModuleNotFoundError as missing:
            if missing.name != "sensor_msgs_py":
                raise
            from tf2_sensor_msgs import _point_cloud2_standin as owner
        globals()[name] = getattr(owner, name)
        return globals()[name]
