# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Broadcast static transforms on /tf_static."""

import tf2_ros_cython._ros_requirement  # noqa: F401

import threading
from collections.abc import Iterable
from copy import deepcopy

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile

from tf2_msgs.msg import TFMessage
from tf2_py import stored_name
from tf2_ros._qos import transforms_qos
from tf2_ros.transform_broadcaster import Broadcaster

__all__ = [
    "DurabilityPolicy",
    "HistoryPolicy",
    "Node",
    "QoSProfile",
    "StaticTransformBroadcaster",
    "TFMessage",
    "TransformStamped",
]


class StaticTransformBroadcaster(Broadcaster):
    """
    Sends transforms on ``/tf_static``, where late subscribers also receive them.

    :param node: publishes them; the attribute ``pub_tf`` is the publisher.
    :param qos: a profile; a depth alone means volatile, as in tf2. None: transient local, depth 1.
    :param strict: raise a ``ValueError`` instead of sending what every buffer refuses.

    Every message contains all transforms sent so far (the attribute ``net_message``), one for each child
    frame. Several threads may send.

    >>> from tf2_ros import StaticTransformBroadcaster
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id = "base_link"
    >>> mount.transform.translation.x = 0.3
    >>> broadcaster = StaticTransformBroadcaster(node)
    >>> broadcaster.sendTransform(mount)
    >>> [sent.child_frame_id for sent in broadcaster.net_message.transforms]
    ['camera']
    """

    def __init__(self, node: Node, qos: QoSProfile | int | None = None, *, strict: bool = False) -> None:
        self.net_message = TFMessage()
        # Held until a message is published, because the last message must contain all transforms.
        self._tf2_sending = threading.RLock()
        # A late subscriber needs only the last message, because it contains all transforms.
        profile = transforms_qos(1, is_static=True) if qos is None else qos
        super().__init__(node, "/tf_static", profile, strict)

    def sendTransform(self, transform: TransformStamped | Iterable[TransformStamped]) -> None:
        """
        Send one transform, or several; each replaces what was sent before for its child frame.

        :param transform: a ``TransformStamped``, or an iterable of them. Static transforms are valid
            at all times, regardless of their stamps. Translations are in meters, rotations unit quaternions.
        :raises AttributeError: ``transform`` is neither; the error is also a ``TypeError``.
        :raises TypeError: a name is not a ``str``.
        :raises ValueError: ``strict`` is true, and a listener would refuse one of them.
        :raises RuntimeError: this is a forked child of the process that made the broadcaster.

        If an exception is raised, none of them is sent or kept.
        """
        new_transforms = self._tf2_list(transform)
        with self._tf2_sending:
            transforms = {stored_name(sent.child_frame_id): sent for sent in self.net_message.transforms}
            for new in new_transforms:
                # Copied, because programs reuse one message.
                transforms[stored_name(new.child_frame_id)] = deepcopy(new)
            merged = list(transforms.values())
            # Kept only afterwards: what cannot be sent would prevent all later messages.
            self._tf2_publish(merged)
            self.net_message.transforms = merged
