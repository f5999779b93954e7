# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""tf2 for nodes: buffers, listeners and broadcasters; and everything of tf2_py."""

# Programs that say `from tf2_ros import *` use these modules and types, which tf2 imports for itself.
import threading
from importlib import import_module
from typing import TYPE_CHECKING, Any, Callable, List, Optional, Tuple, Union  # noqa: UP035  typing's, as in tf2

import tf2_py as tf2
import tf2_ros
from tf2_py import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_py import Explanation as Explanation
from tf2_py import FrameInfo as FrameInfo
from tf2_py import History as History
from tf2_py import Hop as Hop
from tf2_py import __version__ as __version__
from tf2_py import stored_name as stored_name
from tf2_ros import buffer, buffer_interface
from tf2_ros._messages import Header, PoseStamped, TransformStamped
from tf2_ros._sources import BufferSource as BufferSource
from tf2_ros.buffer import Buffer, FrameGraphSrvRequest, FrameGraphSrvResponse
from tf2_ros.buffer_interface import (
    BufferInterface,
    ConvertRegistration,
    NotImplementedException,
    PyKDLType,
    Stamped,
    TransformableObjectType,
    TransformRegistration,
    TypeException,
    convert,
)
from tf2_ros_cython._ros_presence import HAS_ROS

if TYPE_CHECKING or HAS_ROS:
    import rclpy
    import rclpy.action  # programs use it after `import rclpy` alone, because tf2's package imports it
    from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped, Vector3Stamped
    from rclpy.action import ActionClient
    from rclpy.duration import Duration
    from rclpy.node import Node
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
    from rclpy.task import Future
    from rclpy.time import Time

    from tf2_msgs.msg import TFMessage
    from tf2_ros import static_transform_broadcaster, transform_broadcaster, transform_listener
    from tf2_ros.buffer_interface import MsgStamped, TransformableObject
    from tf2_ros.message_filter import FilterFailureReason as FilterFailureReason
    from tf2_ros.message_filter import MessageFilter as MessageFilter
    from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster
    from tf2_ros.transform_broadcaster import TransformBroadcaster
    from tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC, TransformListener

if TYPE_CHECKING:
    from tf2_msgs.action import LookupTransform
    from tf2_ros import buffer_client
    from tf2_ros.buffer_client import BufferClient, LookupTransformGoal, LookupTransformResult
    from tf2_ros.buffer_server import BufferServer as BufferServer
    from tf2_ros.static_transform_listener import StaticTransformListener as StaticTransformListener
elif HAS_ROS:
    # Few programs use these.
    _LATER = {
        "BufferClient": "tf2_ros.buffer_client",
        "BufferServer": "tf2_ros.buffer_server",
        "LookupTransform": "tf2_msgs.action",
        "LookupTransformGoal": "tf2_ros.buffer_client",
        "LookupTransformResult": "tf2_ros.buffer_client",
        "StaticTransformListener": "tf2_ros.static_transform_listener",
        "buffer_client": "tf2_ros.buffer_client",
    }

    def __getattr__(name):
        if name not in _LATER:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module = import_module(_LATER[name])
        globals()[name] = getattr(module, name, module)
        return globals()[name]

    def __dir__():
        return sorted({*globals(), *_LATER})
else:
    from tf2_ros._without_ros import names_that_need_ros

    __getattr__ = names_that_need_ros(
        __name__, "BufferServer", "FilterFailureReason", "MessageFilter", "StaticTransformListener"
    )

# What `import *` gives from tf2's package, and nothing more: a name of ours could hide one of a program's.
__all__ = [
    "DEFAULT_STATIC_TF_TOPIC",
    "DEFAULT_TF_TOPIC",
    "ActionClient",
    "Any",
    "Buffer",
    "BufferClient",
    "BufferCore",
    "BufferInterface",
    "Callable",
    "ConnectivityException",
    "ConvertRegistration",
    "DurabilityPolicy",
    "Duration",
    "ExtrapolationException",
    "FrameGraphSrvRequest",
    "FrameGraphSrvResponse",
    "Future",
    "Header",
    "HistoryPolicy",
    "InvalidArgumentException",
    "List",
    "LookupException",
    "LookupTransform",
    "LookupTransformGoal",
    "LookupTransformResult",
    "MsgStamped",
    "Node",
    "NotImplementedException",
    "Optional",
    "PointStamped",
    "PoseStamped",
    "PoseWithCovarianceStamped",
    "PyKDLType",
    "QoSProfile",
    "Stamped",
    "StaticTransformBroadcaster",
    "TFMessage",
    "Time",
    "TimeoutException",
    "TransformBroadcaster",
    "TransformException",
    "TransformListener",
    "TransformRegistration",
    "TransformStamped",
    "TransformableObject",
    "TransformableObjectType",
    "Tuple",
    "TypeException",
    "Union",
    "Vector3Stamped",
    "buffer",
    "buffer_client",
    "buffer_interface",
    "convert",
    "rclpy",
    "static_transform_broadcaster",
    "tf2",
    "tf2_ros",
    "threading",
    "transform_broadcaster",
    "transform_listener",
]
