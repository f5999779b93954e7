"""Names that programs import from tf2's modules, which have them only because they import them."""

import threading
import warnings
from copy import deepcopy
from threading import Thread
from time import sleep
from typing import (  # noqa: UP035
    TYPE_CHECKING,
    Any,
    Callable,
    List,
    Optional,
    Tuple,
    TypeVar,
    Union,
)

import tf2_py as tf2
import tf2_ros
from tf2_ros_cython._presence import HAS_ROS

if TYPE_CHECKING or HAS_ROS:
    import rclpy  # where it does not load, its own error says why

    # isort: split

    import builtin_interfaces.msg
    import rclpy.clock
    import rclpy.logging
    import rclpy.time
    from rclpy.callback_groups import ReentrantCallbackGroup
    from rclpy.clock import Clock, JumpThreshold, TimeJump
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
    from rclpy.task import Future
    from rclpy.time import Time

__all__ = [
    "Any",
    "Callable",
    "Clock",
    "DurabilityPolicy",
    "FrameGraphSrvRequest",
    "FrameGraphSrvResponse",
    "Future",
    "HistoryPolicy",
    "JumpThreshold",
    "List",
    "LookupTransformGoal",
    "LookupTransformResult",
    "Node",
    "Optional",
    "QoSProfile",
    "ReentrantCallbackGroup",
    "SingleThreadedExecutor",
    "Thread",
    "Time",
    "TimeJump",
    "Tuple",
    "TypeVar",
    "Union",
    "builtin_interfaces",
    "deepcopy",
    "rclpy",
    "sleep",
    "tf2",
    "tf2_ros",
    "threading",
    "warnings",
]

FrameGraphSrvRequest = TypeVar("FrameGraphSrvRequest")
FrameGraphSrvResponse = TypeVar("FrameGraphSrvResponse")
LookupTransformGoal = TypeVar("LookupTransformGoal")
LookupTransformResult = TypeVar("LookupTransformResult")
PyKDLType = TypeVar("PyKDLType")

# Those that need ROS, if there is none.
LACKING = [name for name in __all__ if name not in globals()]
if not TYPE_CHECKING:
    __all__ = [name for name in __all__ if name not in LACKING]

# The names in each module that are neither its own nor this project's.
_IN_MODULES = {
    "tf2_ros.buffer": (
        "Any Callable Duration FrameGraph FrameGraphSrvRequest FrameGraphSrvResponse Future "
        "JumpThreshold List Node Optional Time TimeJump TransformStamped Tuple TypeVar rclpy "
        "sleep tf2 tf2_ros threading"
    ),
    "tf2_ros.buffer_client": (
        "ActionClient Clock Duration LookupTransform LookupTransformGoal LookupTransformResult "
        "Node Time TransformStamped TypeVar builtin_interfaces sleep tf2 tf2_ros threading "
        "warnings"
    ),
    "tf2_ros.buffer_interface": (
        "Any Callable Duration Header Optional PointCloud2 PointStamped PoseStamped "
        "PoseWithCovarianceStamped Time TransformStamped Tuple TypeVar Union Vector3Stamped "
        "deepcopy rclpy tf2 tf2_ros"
    ),
    "tf2_ros.transform_listener": (
        "Buffer DurabilityPolicy HistoryPolicy Node Optional QoSProfile ReentrantCallbackGroup "
        "SingleThreadedExecutor TFMessage Thread Union tf2_ros"
    ),
    "tf2_ros.transform_broadcaster": ("List Node Optional QoSProfile TFMessage TransformStamped Union"),
    "tf2_ros.static_transform_broadcaster": (
        "DurabilityPolicy HistoryPolicy List Node Optional QoSProfile TFMessage TransformStamped Union"
    ),
}


def add_names_of_tf2(namespace: dict[str, Any]) -> None:
    """
    Add the names of tf2's module, so that programs find them in it, and by ``import *``.

    Type checkers see only the module's own names.

    :param namespace: the globals of the module, with its own names in ``__all__``.
    """
    names = _IN_MODULES[namespace["__name__"]].split()
    namespace.update({name: globals()[name] for name in names if name in globals()})
    namespace["__all__"] = sorted([*namespace["__all__"], *names])
