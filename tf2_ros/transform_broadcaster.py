"""Broadcast transforms on /tf."""

# Imported first, because it explains what to install if the imports below fail.
from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

import os
from collections.abc import Iterable

from geometry_msgs.msg import TransformStamped
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from tf2_msgs.msg import TFMessage
from tf2_py._internal import MalformedObjectError, refused, serialize_transforms
from tf2_ros import _names
from tf2_ros._arguments import kind_of, require_node
from tf2_ros._forking import refuse_inherited
from tf2_ros._qos import transforms_qos

__all__ = ["TransformBroadcaster"]
_names.offer(globals())

MOST_WARNINGS = 100


class RefusedTransforms:
    """
    Raises, or warns once for each child frame, about transforms that every listener would refuse.

    :param strict: raise.
    """

    def __init__(self, strict: bool) -> None:
        self._strict = strict
        self._warned: set[str] = set()

    def before_sending(self, transforms: list[TransformStamped]) -> None:
        """Raise a ValueError about one that would be refused, if this is strict."""
        if self._strict:
            require_transforms(transforms)
            for _, why in refused(transforms):
                raise ValueError(why)

    def after_sending(self, refused: Iterable[tuple[str, str]]) -> None:
        """Warn about those that no listener accepts: pairs of a ``child_frame_id`` and the reason."""
        if self._strict:
            return
        for child, why in refused:
            if child not in self._warned and len(self._warned) < MOST_WARNINGS:
                self._warned.add(child)
                get_logger("tf2_ros").warning(f"Sent anyway (strict=True would raise): {why}")


class TransformBroadcaster:
    """
    Sends transforms on ``/tf``.

    :param node: publishes them; the attribute ``pub_tf`` is the publisher.
    :param qos: a profile, or the depth of its queue. None: volatile, depth 100.
    :param strict: raise instead of sending what every listener would refuse: for example, a transform without
        names, or with a rotation of zero length. False: send it, and warn once for each child frame.

    >>> from geometry_msgs.msg import TransformStamped
    >>> from tf2_ros import TransformBroadcaster
    >>> pose = TransformStamped(child_frame_id="base_link")
    >>> pose.header.frame_id, pose.header.stamp = "odom", node.get_clock().now().to_msg()
    >>> pose.transform.translation.x = 1.5
    >>> TransformBroadcaster(node).sendTransform(pose)
    """

    # If a subclass does not call __init__.
    _tf2_refused = RefusedTransforms(strict=False)
    _tf2_process: int | None = None

    def __init__(self, node: Node, qos: QoSProfile | int | None = None, *, strict: bool = False) -> None:
        require_node("TransformBroadcaster", node, "create_publisher")
        self._tf2_process = os.getpid()
        self._tf2_refused = RefusedTransforms(strict)
        profile = transforms_qos(100, is_static=False) if qos is None else qos
        self.pub_tf = node.create_publisher(TFMessage, "/tf", profile)

    def sendTransform(self, transform: TransformStamped | Iterable[TransformStamped]) -> None:
        """
        Send one transform, or several in one message.

        :param transform: a ``TransformStamped``, or an iterable of them: translations in metres, rotations as
            unit quaternions. A receiver takes a stamp of 0 as a time like any other.
        :raises AttributeError: it is something else.
        :raises ValueError: ``strict`` is true, and a listener would refuse one of them; nothing is sent.
        :raises RuntimeError: this is a forked child of the process that made the broadcaster.
        """
        if self._tf2_process is not None:
            refuse_inherited(self, self._tf2_process)
        transforms = transforms_of(transform)
        self._tf2_refused.before_sending(transforms)
        self._tf2_refused.after_sending(publish_transforms(self.pub_tf, transforms))


def require_transforms(transforms: list[TransformStamped]) -> None:
    """Raise a TypeError, which is also an AttributeError as in tf2, if one is something else."""
    for one in transforms:
        if not isinstance(one, TransformStamped):
            raise MalformedObjectError(
                f"sendTransform: expected a TransformStamped, or several, got {kind_of(one)}"
            )


def transforms_of(transform: TransformStamped | Iterable[TransformStamped]) -> list[TransformStamped]:
    """Make a list of the argument of a broadcaster."""
    return list(transform) if isinstance(transform, Iterable) else [transform]


def publish_transforms(publisher: Publisher, transforms: list[TransformStamped]) -> list[tuple[str, str]]:
    """
    Publish one TFMessage, serialised by tf2_py if that gives the same bytes as ROS.

    :raises AttributeError: one is not a TransformStamped; nothing is published.
    :return: those that every buffer refuses, as pairs: the ``child_frame_id`` and the reason.
    """
    serialized = serialize_transforms(transforms) if _takes_bytes(publisher) else None
    if serialized is None:
        require_transforms(transforms)  # serialising checks this, too
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
