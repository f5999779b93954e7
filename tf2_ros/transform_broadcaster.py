# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Broadcast transforms on /tf."""

import tf2_ros_cython._ros_requirement  # noqa: F401

import os
from collections.abc import Iterable

from geometry_msgs.msg import TransformStamped
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from tf2_msgs.msg import TFMessage
from tf2_py._internal import MalformedObjectError, bool_of, refused_transforms, serialize_as_ros
from tf2_ros._arguments import kind_of
from tf2_ros._nodes.ended_nodes import require_node
from tf2_ros._process.forking import refuse_inherited
from tf2_ros._qos import transforms_qos

__all__ = [
    "Node",
    "QoSProfile",
    "TFMessage",
    "TransformBroadcaster",
    "TransformStamped",
]

_publish = Publisher.publish


class Broadcaster:
    """
    A publisher that raises or warns, once for each child frame, if every listener would refuse a transform.

    :param strict: raise.
    """

    # For a subclass that makes another publisher instead of calling __init__.
    _tf2_process: int | None = None
    _tf2_strict = False
    _tf2_warned: set[str] = set()  # the child frames that it has warned about

    def __init__(self, node: Node, topic: str, qos: QoSProfile | int, strict: bool) -> None:
        require_node(type(self).__name__, node, "create_publisher")
        self._tf2_process = os.getpid()
        self._tf2_strict = bool_of(strict, "strict")
        self._tf2_warned = set()
        self.pub_tf = node.create_publisher(TFMessage, topic, qos)

    def _tf2_list(self, transform: TransformStamped | Iterable[TransformStamped]) -> list[TransformStamped]:
        """Make a list of the argument of ``sendTransform``; raise what that raises."""
        refuse_inherited(self, self._tf2_process)
        transforms = list(transform) if isinstance(transform, Iterable) else [transform]
        for one in transforms:
            if not isinstance(one, TransformStamped):
                text = f"sendTransform: expected a TransformStamped, or several, got {kind_of(one)}"
                raise MalformedObjectError(text)  # a TypeError, and an AttributeError as in tf2
        if self._tf2_strict:
            for _, why in refused_transforms(transforms):
                raise ValueError(why)
        return transforms

    def _tf2_publish(self, transforms: list[TransformStamped]) -> None:
        """Publish one TFMessage, serialized by tf2_py if that gives the same bytes as ROS."""
        # A program's replacement for the publisher or its method, such as a mock, expects messages.
        takes_bytes = getattr(self.pub_tf.publish, "__func__", None) is _publish
        serialized = serialize_as_ros(transforms) if takes_bytes else None
        if serialized is None:
            self.pub_tf.publish(TFMessage(transforms=transforms))
            unwanted = refused_transforms(transforms)
        else:
            data, unwanted = serialized
            self.pub_tf.publish(data)
        for child, why in unwanted:
            if child not in self._tf2_warned:
                self._tf2_warned.add(child)
                get_logger("tf2_ros").warning(f"Sent anyway (strict=True would raise): {why}")


class TransformBroadcaster(Broadcaster):
    """
    Sends transforms on ``/tf``.

    :param node: publishes them; the attribute ``pub_tf`` is the publisher.
    :param qos: a profile, or the depth of its queue. None: volatile, depth 100.
    :param strict: raise instead of sending what every listener would refuse: for example, a transform without
        names, or with a rotation of zero length. False: send it, and warn once for each child frame.

    >>> from geometry_msgs.msg import TransformStamped
    >>> from tf2_ros import TransformBroadcaster
    >>> pose = TransformStamped(child_frame_id="base_link")
    >>> pose.header.frame_id = "odom"
    >>> pose.header.stamp = node.get_clock().now().to_msg()
    >>> pose.transform.translation.x = 1.5
    >>> TransformBroadcaster(node).sendTransform(pose)
    """

    def __init__(self, node: Node, qos: QoSProfile | int | None = None, *, strict: bool = False) -> None:
        profile = transforms_qos(100, is_static=False) if qos is None else qos
        super().__init__(node, "/tf", profile, strict)

    def sendTransform(self, transform: TransformStamped | Iterable[TransformStamped]) -> None:
        """
        Send one transform, or several in one message.

        :param transform: a ``TransformStamped``, or an iterable of them: translations in meters, rotations as
            unit quaternions. A stamp of 0 is the time 0 (1970), not "now": buffers with newer samples of the
            frame usually refuse it as too old.
        :raises AttributeError: ``transform`` is neither; the error is also a ``TypeError``.
        :raises ValueError: ``strict`` is true, and a listener would refuse one of them; nothing is sent.
        :raises RuntimeError: this is a forked child of the process that made the broadcaster.
        """
        self._tf2_publish(self._tf2_list(transform))
