"""tf2 for nodes: buffers, listeners and broadcasters; and everything of tf2_py."""

from typing import TYPE_CHECKING

from tf2_py import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_py import FrameInfo as FrameInfo
from tf2_py import History as History
from tf2_py import __version__ as __version__
from tf2_py import stored_name as stored_name
from tf2_ros import _names
from tf2_ros._messages import format_transform as format_transform
from tf2_ros._shared.naming import SharedBufferError as SharedBufferError
from tf2_ros.buffer import Buffer
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

if TYPE_CHECKING:
    from geometry_msgs.msg import PointStamped as PointStamped
    from geometry_msgs.msg import PoseStamped as PoseStamped
    from geometry_msgs.msg import PoseWithCovarianceStamped as PoseWithCovarianceStamped
    from geometry_msgs.msg import TransformStamped as TransformStamped
    from geometry_msgs.msg import Vector3Stamped as Vector3Stamped

    from tf2_ros._tf2_types import MsgStamped, TransformableObject
    from tf2_ros.buffer import FrameGraphSrvRequest, FrameGraphSrvResponse
    from tf2_ros.buffer_client import BufferClient, LookupTransformGoal, LookupTransformResult
    from tf2_ros.buffer_server import BufferServer as BufferServer
    from tf2_ros.message_filter import FilterFailureReason as FilterFailureReason
    from tf2_ros.message_filter import MessageFilter as MessageFilter
    from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster
    from tf2_ros.transform_broadcaster import TransformBroadcaster
    from tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC, TransformListener
    from tf2_ros.transform_listener import StaticTransformListener as StaticTransformListener

# What `import *` gives from tf2's package, and nothing more: a name of ours could hide one of a program's.
__all__ = [
    "DEFAULT_STATIC_TF_TOPIC",
    "DEFAULT_TF_TOPIC",
    "Buffer",
    "BufferClient",
    "BufferCore",
    "BufferInterface",
    "ConnectivityException",
    "ConvertRegistration",
    "ExtrapolationException",
    "FrameGraphSrvRequest",
    "FrameGraphSrvResponse",
    "InvalidArgumentException",
    "LookupException",
    "LookupTransformGoal",
    "LookupTransformResult",
    "MsgStamped",
    "NotImplementedException",
    "PyKDLType",
    "Stamped",
    "StaticTransformBroadcaster",
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
_names.offer(globals(), *_names.OF_OTHERS)
