# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Provide buffers that a listener fills, for programs."""

# First, because their errors say in one line what is missing, or that another tf2_ros is imported.
from tf2_ros.records import Recording
from tf2_ros.transform_listener import TransformListener

# isort: split

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rclpy.node import Node
from rclpy.qos import QoSProfile

from tf2_ros import Buffer
from tf2_ros_tools.common.program import UsageError
from tf2_ros_tools.listening.session import TOPICS


@contextmanager
def filled_buffer(
    node: Node,
    recording: Recording | None = None,
    *,
    topics: Sequence[str] = TOPICS,
    cache_time: float | None = None,
    qos: QoSProfile | None = None,
) -> Iterator[Buffer]:
    """
    A buffer for a ``with`` statement. A listener fills it, and it follows the clock of the node.

    :param recording: records what arrives.
    :param topics: the topic of dynamic transforms and the topic of static transforms.
    :param cache_time: how far each frame's history reaches back, in seconds. None: the default of buffers.
    :param qos: of dynamic transforms. None: the default of listeners.
    :raises UsageError: the receiver, which recording needs, does not support this release of ROS 2 or its
        middleware.
    """
    buffer = Buffer(cache_time, node)
    # A program that only observes must not answer those who ask the robot for its frames.
    if buffer.srv is not None:
        node.destroy_service(buffer.srv)
        buffer.srv = None
    try:
        listener = TransformListener(
            buffer, node, qos=qos, recording=recording, tf_topic=topics[0], tf_static_topic=topics[1]
        )
    except NotImplementedError as refusal:
        raise UsageError(str(refusal)) from None
    with listener:
        yield buffer
