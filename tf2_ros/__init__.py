"""tf2 for nodes: buffers, listeners and broadcasters; and everything of tf2_py."""

# Before the imports below fail without a word of advice or, on another ROS 2 than the one built for, crash.
from tf2_ros_cython import _requirement as _requirement

# isort: split

# Classes that programs came to rely on finding here; they stay, outside __all__.
from geometry_msgs.msg import PointStamped as PointStamped
from geometry_msgs.msg import PoseStamped as PoseStamped
from geometry_msgs.msg import PoseWithCovarianceStamped as PoseWithCovarianceStamped
from geometry_msgs.msg import TransformStamped as TransformStamped
from geometry_msgs.msg import Vector3Stamped as Vector3Stamped
from rclpy.duration import Duration as Duration
from rclpy.time import Time as Time
from sensor_msgs.msg import PointCloud2 as PointCloud2
from std_msgs.msg import Header as Header

from tf2_msgs.action import LookupTransform as LookupTransform
from tf2_msgs.msg import TFMessage as TFMessage
from tf2_msgs.srv import FrameGraph as FrameGraph
from tf2_py import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_ros.buffer import Buffer
from tf2_ros.buffer_client import BufferClient
from tf2_ros.buffer_interface import (
    BufferInterface,
    ConvertRegistration,
    MsgStamped,
    NotImplementedException,
    PyKDLType,
    Stamped,
    TransformableObject,
    TransformableObjectType,
    TransformRegistration,
    TypeException,
    convert,
)
from tf2_ros.buffer_server import BufferServer
from tf2_ros.message_filter import FilterFailureReason, MessageFilter
from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster
from tf2_ros.transform_broadcaster import TransformBroadcaster
from tf2_ros.transform_listener import (
    DEFAULT_STATIC_TF_TOPIC,
    DEFAULT_TF_TOPIC,
    StaticTransformListener,
    TransformListener,
)

__all__ = [
    "DEFAULT_STATIC_TF_TOPIC",
    "DEFAULT_TF_TOPIC",
    "Buffer",
    "BufferClient",
    "BufferCore",
    "BufferInterface",
    "BufferServer",
    "ConnectivityException",
    "ConvertRegistration",
    "ExtrapolationException",
    "FilterFailureReason",
    "InvalidArgumentException",
    "LookupException",
    "MessageFilter",
    "MsgStamped",
    "NotImplementedException",
    "PyKDLType",
    "Stamped",
    "StaticTransformBroadcaster",
    "StaticTransformListener",
    "TimeoutException",
    "TransformBroadcaster",
    "TransformException",
    "TransformListener",
    "TransformRegistration",
    "TransformableObject",
    "TransformableObjectType",
    "TypeException",
    "convert",
]
