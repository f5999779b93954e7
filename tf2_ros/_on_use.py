"""Names that a module gets on their first use. Without ROS, using one that needs ROS says what to install."""

from collections.abc import Collection
from importlib import import_module
from typing import Any

from tf2_ros_cython._presence import HAS_ROS, absence

# Few programs use these, and importing most of them takes about as long as importing the rest of tf2_ros.
SOURCES = {
    "ActionClient": "tf2_ros.buffer_client",
    "BufferClient": "tf2_ros.buffer_client",
    "BufferServer": "tf2_ros.buffer_server",
    "FilterFailureReason": "tf2_ros.message_filter",
    "LookupTransform": "tf2_msgs.action",
    "MessageFilter": "tf2_ros.message_filter",
    "MsgStamped": "tf2_ros._tf2_types",
    "PointCloud2": "sensor_msgs.msg",
    "PointStamped": "geometry_msgs.msg",
    "PoseWithCovarianceStamped": "geometry_msgs.msg",
    "TransformableObject": "tf2_ros._tf2_types",
    "Vector3Stamped": "geometry_msgs.msg",
    "buffer_client": "tf2_ros",
}


def offer(namespace: dict[str, Any], others: Collection[str] = ()) -> None:
    """
    Let a module have all its names.

    :param namespace: the globals of the module, with the names that ``import *`` gives in ``__all__``. Those
        that are not among the globals are imported on their first use. Without ROS, they are left out of
        ``__all__``, and using one raises an error.
    :param others: more names like these, which ``import *`` does not import.
    """
    module = namespace["__name__"]
    lacking = {name for name in (*namespace["__all__"], *others) if name not in namespace}

    def __getattr__(name: str) -> Any:
        if name not in lacking:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        if not HAS_ROS:
            raise absence(f"{module}.{name}")
        source = SOURCES[name]
        value = (
            import_module(f"{source}.{name}") if source == module else getattr(import_module(source), name)
        )
        namespace[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*namespace, *lacking} if HAS_ROS else namespace)

    namespace["__getattr__"], namespace["__dir__"] = __getattr__, __dir__
    if not HAS_ROS:
        namespace["__all__"] = [name for name in namespace["__all__"] if name not in lacking]
