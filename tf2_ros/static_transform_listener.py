# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Receive static transforms only, and insert them into a buffer."""

import tf2_ros_cython._ros_requirement  # noqa: F401

from rclpy.node import Node
from rclpy.qos import QoSProfile

from tf2_ros.transform_listener import (
    DEFAULT_STATIC_TF_TOPIC,
    DEFAULT_TF_TOPIC,
    TransformListener,
    TransformSink,
)

__all__ = ["DEFAULT_STATIC_TF_TOPIC", "DEFAULT_TF_TOPIC", "StaticTransformListener"]


class StaticTransformListener(TransformListener):
    """
    Fills a buffer with static transforms only. It has the arguments of a :class:`TransformListener`, except
    for those that concern dynamic transforms.
    """

    def __init__(
        self,
        buffer: TransformSink,
        node: Node | None = None,
        *,
        spin_thread: bool = False,
        static_qos: QoSProfile | int | None = None,
        tf_static_topic: str = DEFAULT_STATIC_TF_TOPIC,
        prefix: str = "",
    ) -> None:
        super().__init__(
            buffer,
            node,
            spin_thread=spin_thread,
            static_qos=static_qos,
            tf_static_topic=tf_static_topic,
            static_only=True,
            prefix=prefix,
        )
