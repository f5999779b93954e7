"""Owns sending transforms on /tf."""

from collections.abc import Iterable

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from tf2_msgs.msg import TFMessage
from tf2_py._objects.serialize import serialize_transforms
from tf2_ros._qos import dynamic_broadcaster_qos, dynamic_overrides
from tf2_ros._tf2_names import (
    List,
    Optional,
    Union,
)

# What `import *` gives from tf2's module.
__all__ = [
    "List",
    "Node",
    "Optional",
    "QoSProfile",
    "TFMessage",
    "TransformBroadcaster",
    "TransformStamped",
    "Union",
]


class TransformBroadcaster:
    """
    Sends transforms on ``/tf``.

    :param node: publishes them; the attribute ``pub_tf`` is the publisher.
    :param qos: a profile, or the depth of its queue.
    """

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        overrides = {}
        if qos is None:
            qos = dynamic_broadcaster_qos()
            overrides = dynamic_overrides(node, "/tf", "publisher")
        self.pub_tf = node.create_publisher(TFMessage, "/tf", qos, **overrides)

    def sendTransform(self, transform: TransformStamped | Iterable[TransformStamped]) -> None:
        """Send one transform, or several in one message."""
        publish_transforms(self.pub_tf, transforms_of(transform))


def transforms_of(transform: TransformStamped | Iterable[TransformStamped]) -> list[TransformStamped]:
    """Make a list of what a broadcaster was given."""
    return list(transform) if isinstance(transform, Iterable) else [transform]


def publish_transforms(publisher: Publisher, transforms: list[TransformStamped]) -> None:
    """Publish one TFMessage, written by the engine where that is sure to say what ROS's conversion would."""
    data = serialize_transforms(transforms) if _takes_bytes(publisher) else None
    publisher.publish(TFMessage(transforms=transforms) if data is None else data)


_publish = Publisher.publish


def _takes_bytes(publisher: Publisher) -> bool:
    # Whatever a program puts in the place of rclpy's publisher expects messages.
    return (
        type(publisher) is Publisher and Publisher.publish is _publish and "publish" not in publisher.__dict__
    )
