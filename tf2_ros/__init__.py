"""tf2 for nodes: buffers, listeners and broadcasters; and everything of tf2_py."""

from typing import TYPE_CHECKING

# Imported first, because it explains what to install if the imports below fail.
from tf2_py import BufferCore
from tf2_ros_cython._presence import HAS_ROS
from tf2_ros_cython._ros import __version__ as __version__

# isort: split

from tf2_py import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
    add_dll_directories_from_env,
)
from tf2_py import FrameInfo as FrameInfo
from tf2_py import History as History
from tf2_ros import _on_use, _tf2_names, buffer, buffer_interface
from tf2_ros._messages import Header, PoseStamped, TransformStamped
from tf2_ros._messages import format_transform as format_transform
from tf2_ros._shared.naming import SharedBufferError as SharedBufferError
from tf2_ros._tf2_names import *  # noqa: F403
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

if TYPE_CHECKING or HAS_ROS:
    from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped, Vector3Stamped
    from rclpy.duration import Duration

    from tf2_msgs.msg import TFMessage
    from tf2_msgs.srv import FrameGraph
    from tf2_ros import static_transform_broadcaster, transform_broadcaster, transform_listener
    from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster
    from tf2_ros.transform_broadcaster import TransformBroadcaster
    from tf2_ros.transform_listener import (
        DEFAULT_STATIC_TF_TOPIC,
        DEFAULT_TF_TOPIC,
        TransformListener,
    )
    from tf2_ros.transform_listener import StaticTransformListener as StaticTransformListener

if TYPE_CHECKING:
    from rclpy.action.client import ActionClient
    from sensor_msgs.msg import PointCloud2

    from tf2_msgs.action import LookupTransform
    from tf2_ros import buffer_client
    from tf2_ros.buffer_client import BufferClient
    from tf2_ros.buffer_interface import MsgStamped, TransformableObject
    from tf2_ros.buffer_server import BufferServer as BufferServer
    from tf2_ros.message_filter import FilterFailureReason as FilterFailureReason
    from tf2_ros.message_filter import MessageFilter as MessageFilter

# What `import *` gives from tf2's package, accidental names included, and nothing more: a name of ours could
# hide one of a program's. The others are imported by name.
__all__ = [
    "DEFAULT_STATIC_TF_TOPIC",
    "DEFAULT_TF_TOPIC",
    "ActionClient",
    "Buffer",
    "BufferClient",
    "BufferCore",
    "BufferInterface",
    "ConnectivityException",
    "ConvertRegistration",
    "Duration",
    "ExtrapolationException",
    "FrameGraph",
    "Header",
    "InvalidArgumentException",
    "LookupException",
    "LookupTransform",
    "MsgStamped",
    "NotImplementedException",
    "PointCloud2",
    "PointStamped",
    "PoseStamped",
    "PoseWithCovarianceStamped",
    "PyKDLType",
    "Stamped",
    "StaticTransformBroadcaster",
    "TFMessage",
    "TimeoutException",
    "TransformBroadcaster",
    "TransformException",
    "TransformListener",
    "TransformRegistration",
    "TransformStamped",
    "TransformableObject",
    "TransformableObjectType",
    "TypeException",
    "Vector3Stamped",
    "add_dll_directories_from_env",
    "buffer",
    "buffer_client",
    "buffer_interface",
    "convert",
    "static_transform_broadcaster",
    "transform_broadcaster",
    "transform_listener",
]
__all__ += _tf2_names.__all__

_on_use.offer(
    globals(),
    {"BufferServer", "FilterFailureReason", "MessageFilter", "StaticTransformListener", *_tf2_names.LACKING},
)
