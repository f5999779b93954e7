# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Choose what a program listens to, by its command line: a node of ROS, or a robot without ROS."""

# First, as in session.py.
from tf2_ros.records import Recording

# isort: split

from argparse import Namespace
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING

from tf2_ros_tools.listening.session import TOPICS, Listening, Session

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile


def session(
    name: str,
    options: Namespace,
    recording: Recording | None = None,
    *,
    topics: tuple[str, str] = TOPICS,
    cache_time: float | None = None,
    qos: "QoSProfile | None" = None,
) -> AbstractContextManager[Session]:
    """
    A session for a ``with`` statement: of a node, or of what ``--live`` names.

    :param name: of the node.
    :param options: of the command line.
    :param recording: records what arrives.
    :param topics: the topic of dynamic transforms and the topic of static transforms.
    :param cache_time: how far each frame's history reaches back, in seconds. None: the default of buffers.
    :param qos: of dynamic transforms, for a node. None: the default of listeners.
    :raises UsageError: the command line contains a name or a parameter that ROS refuses, or recording needs a
        receiver that does not support this release of ROS 2 or its middleware.
    """
    if getattr(options, "live", None) is None:
        try:
            from tf2_ros_tools.nodes.node_session import node_session
        except ImportError as lack:
            # Another tf2_ros that is imported is the trouble, not the lack of ROS.
            if not hasattr(options, "live") or find_spec("rclpy") is not None:
                raise
            raise ImportError(f"{lack}; or listen without ROS 2: --live dds://") from lack
        return node_session(name, options, recording, topics=topics, cache_time=cache_time, qos=qos)
    from tf2_ros_tools.live.feed_session import live_session

    return live_session(options.live, recording, topics=topics, cache_time=cache_time)


@contextmanager
def listening(
    name: str,
    options: Namespace,
    window_s: float | None = None,
    *,
    topics: tuple[str, str] = TOPICS,
    cache_time: float | None = None,
) -> Iterator[Listening]:
    """
    Listen in a ``with`` statement.

    :param window_s: the period over which figures are computed. None: all time.

    For the other parameters, see :func:`session`.
    """
    recording = Recording()
    with session(name, options, recording, topics=topics, cache_time=cache_time) as heard:
        yield Listening(heard, recording, window_s)
