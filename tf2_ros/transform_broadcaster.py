"""Owns sending transforms on /tf."""

# Before the imports below fail without a word of advice.
from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

from collections.abc import Iterable

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from tf2_msgs.msg import TFMessage
from tf2_py._internal import refused, serialize_transforms
from tf2_ros._arguments import require_node
from tf2_ros._qos import dynamic_broadcaster_qos, dynamic_overrides
from tf2_ros._refused import RefusedTransforms, require_transforms
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
    :param qos: a profile, or the depth of its queue. None: volatile, depth 100, which parameters of the node
        may override.
    :param strict: raise instead of sending what every listener would refuse: for example, a transform without
        names, or with a rotation of no length. False: send it, and warn once for each child frame.

    >>> from geometry_msgs.msg import TransformStamped
    >>> from tf2_ros import TransformBroadcaster
    >>> pose = TransformStamped(child_frame_id="base_link")
    >>> pose.header.frame_id, pose.header.stamp = "odom", node.get_clock().now().to_msg()
    >>> pose.transform.translation.x = 1.5
    >>> TransformBroadcaster(node).sendTransform(pose)
    """

    _refused = RefusedTransforms(strict=False)  # where a subclass does not call __init__

    def __init__(self, node: Node, qos: QoSProfile | int | None = None, *, strict: bool = False) -> None:
        require_node("TransformBroadcaster", node, "create_publisher")
        self._refused = RefusedTransforms(strict)
        overrides = {}
        if qos is None:
            qos = dynamic_broadcaster_qos()
            overrides = dynamic_overrides(node, "/tf", "publisher")
        self.pub_tf = node.create_publisher(TFMessage, "/tf", qos, **overrides)

    def sendTransform(self, transform: TransformStamped | Iterable[TransformStamped]) -> None:
        """
        Send one transform, or several in one message.

        :param transform: a ``TransformStamped``, or an iterable of them: translations in metres, rotations as
            unit quaternions. A receiver takes a stamp of 0 as a time like any other.
        :raises AttributeError: it is something else.
        :raises ValueError: ``strict``, and a listener would refuse one of them; nothing is sent.
        """
        transforms = transforms_of(transform)
        self._refused.before_sending(transforms)
        self._refused.after_sending(publish_transforms(self.pub_tf, transforms))


def transforms_of(transform: TransformStamped | Iterable[TransformStamped]) -> list[TransformStamped]:
    """Make a list of what a broadcaster was given."""
    return list(transform) if isinstance(transform, Iterable) else [transform]


def publish_transforms(publisher: Publisher, transforms: list[TransformStamped]) -> list[tuple[str, str]]:
    """
    Publish one TFMessage, serialised by tf2_py where that certainly gives the same bytes as ROS.

    :raises AttributeError: one is no TransformStamped; nothing is published.
    :return: those that every buffer refuses, as pairs: the ``child_frame_id`` and the reason.
    """
    serialized = serialize_transforms(transforms) if _takes_bytes(publisher) else None
    if serialized is None:
        require_transforms(transforms)  # what was serialised are such
        publisher.publish(TFMessage(transforms=transforms))
        return refused(transforms)
    data, sent_for_nothing = serialized
    publisher.publish(data)
    return sent_for_nothing


_publish = Publisher.publish


def _takes_bytes(publisher: Publisher) -> bool:
    # A program's replacement for rclpy's publisher expects messages.
    return (
        type(publisher) is Publisher and Publisher.publish is _publish and "publish" not in publisher.__dict__
    )
