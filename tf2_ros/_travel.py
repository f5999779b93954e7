"""Owns what of a Buffer does not travel with its pickles and copies: whatever belongs to a node."""

import warnings
from typing import Any, TypeVar

from tf2_ros_cython._presence import HAS_ROS

__all__ = ["stays", "without_node"]

_Class = TypeVar("_Class", bound=type)

# What `Buffer.__init__` sets; a buffer that arrives has its own.
OF_INIT = {"registration", "_wait_contexts", "srv", "clock", "jump_handle", "_sharing"}


# The classes of attributes that stay behind.
_STAYING: list[type] = []

if HAS_ROS:
    from rclpy.clock import Clock, JumpHandle
    from rclpy.node import Node
    from rclpy.service import Service

    _STAYING += [Clock, JumpHandle, Node, Service]


def stays(kind: _Class) -> _Class:
    """An object of this class does not travel with the Buffer whose attribute it is; a decorator."""
    _STAYING.append(kind)
    return kind


def without_node(attributes: dict[str, Any], class_name: str) -> dict[str, Any]:
    """
    The attributes of a Buffer that travel. A UserWarning says what belongs to a node and does not.

    :param class_name: of the buffer, for the warning, which is that of the caller's caller.
    """
    service = ["the service tf2_frames"] if attributes.get("srv") is not None else []
    travelling = {name: value for name, value in attributes.items() if name not in OF_INIT}
    staying = {name for name, value in travelling.items() if isinstance(value, tuple(_STAYING))}
    if service or staying:
        warnings.warn(
            f"the node of a {class_name} does not travel with it: the copy has a clock of its own, and lacks "
            + ", ".join(service + [f"its attribute {name!r}" for name in sorted(staying)]),
            stacklevel=3,
        )
    return {name: value for name, value in travelling.items() if name not in staying}
