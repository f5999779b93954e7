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
    Iterable,
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

__all__ = [
    "Any",
    "Callable",
    "Clock",
    "DurabilityPolicy",
    "FrameGraphSrvRequest",
    "FrameGraphSrvResponse",
    "Future",
    "HistoryPolicy",
    "Iterable",
    "JumpThreshold",
    "List",
    "LookupTransformGoal",
    "LookupTransformResult",
    "Node",
    "Optional",
    "PyKDLType",
    "QoSProfile",
    "ReentrantCallbackGroup",
    "SingleThreadedExecutor",
    "Thread",
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
