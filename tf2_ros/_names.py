"""Names that tf2_ros and its modules import on their first use; without ROS, they say what to install."""

from importlib import import_module
from typing import Any

from tf2_ros_cython._presence import HAS_ROS, absence

# Names of this project that need ROS, or whose import takes long, by the module that has them.
_OURS = {
    "tf2_ros._tf2_types": ("MsgStamped", "TransformableObject"),
    "tf2_ros.buffer": ("FrameGraphSrvRequest", "FrameGraphSrvResponse"),
    "tf2_ros.buffer_client": ("BufferClient", "LookupTransformGoal", "LookupTransformResult"),
    "tf2_ros.buffer_server": ("BufferServer",),
    "tf2_ros.message_filter": ("FilterFailureReason", "MessageFilter"),
    "tf2_ros.static_transform_broadcaster": ("StaticTransformBroadcaster",),
    "tf2_ros.transform_broadcaster": ("TransformBroadcaster",),
    "tf2_ros.transform_listener": (
        "DEFAULT_STATIC_TF_TOPIC",
        "DEFAULT_TF_TOPIC",
        "StaticTransformListener",
        "TransformListener",
    ),
}
# Names that programs import from tf2's modules, which only import them themselves. All of these modules have
# all of them, and ``from tf2_ros import *`` imports them, as from tf2.
_OF_OTHERS = {
    "copy": ("deepcopy",),
    "geometry_msgs.msg": ("PointStamped", "PoseWithCovarianceStamped", "Vector3Stamped"),
    "rclpy.action": ("ActionClient",),
    "rclpy.callback_groups": ("ReentrantCallbackGroup",),
    "rclpy.clock": ("Clock", "JumpThreshold", "TimeJump"),
    "rclpy.duration": ("Duration",),
    "rclpy.executors": ("SingleThreadedExecutor",),
    "rclpy.node": ("Node",),
    "rclpy.qos": ("DurabilityPolicy", "HistoryPolicy", "QoSProfile"),
    "rclpy.task": ("Future",),
    "rclpy.time": ("Time",),
    "sensor_msgs.msg": ("PointCloud2",),
    "tf2_msgs.action": ("LookupTransform",),
    "tf2_msgs.msg": ("TFMessage",),
    "tf2_msgs.srv": ("FrameGraph",),
    "tf2_py": ("add_dll_directories_from_env",),
    "tf2_ros._messages": ("Header", "PoseStamped", "TransformStamped"),
    "tf2_ros.buffer": ("Buffer",),
    "threading": ("Thread",),
    "time": ("sleep",),
    "typing": ("Any", "Callable", "List", "Optional", "Tuple", "TypeVar", "Union"),
}
_MODULES = {
    "buffer": "tf2_ros.buffer",
    "buffer_client": "tf2_ros.buffer_client",
    "buffer_interface": "tf2_ros.buffer_interface",
    "builtin_interfaces": "builtin_interfaces",
    "rclpy": "rclpy",
    "static_transform_broadcaster": "tf2_ros.static_transform_broadcaster",
    "tf2": "tf2_py",
    "tf2_ros": "tf2_ros",
    "threading": "threading",
    "transform_broadcaster": "tf2_ros.transform_broadcaster",
    "transform_listener": "tf2_ros.transform_listener",
    "warnings": "warnings",
}
OF_OTHERS = [*_MODULES, *(name for names in _OF_OTHERS.values() for name in names)]
_SOURCES = _MODULES | {
    name: source for source, names in (*_OURS.items(), *_OF_OTHERS.items()) for name in names
}


def offer(namespace: dict[str, Any], *exported: str) -> None:
    """
    Let the module with these globals have all these names.

    :param exported: of those, the names that ``import *`` gives, too, because tf2's module gives them.
    """
    module = namespace["__name__"]
    namespace["__all__"] = sorted({*namespace["__all__"], *exported})

    def __getattr__(name: str) -> Any:
        if name not in _SOURCES:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        try:
            source = import_module(_SOURCES[name])
        except ModuleNotFoundError:
            if HAS_ROS:
                raise
            raise absence(f"{module}.{name}") from None
        namespace[name] = source if name in _MODULES else getattr(source, name)
        return namespace[name]

    namespace["__getattr__"] = __getattr__
    namespace["__dir__"] = lambda: sorted({*namespace, *_SOURCES})
