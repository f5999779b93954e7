# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Provide the session of a node."""

from tf2_ros_tools.nodes.filled_buffer import filled_buffer
from tf2_ros_tools.nodes.spun_node import spun_node

import re
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

from tf2_ros import Buffer
from tf2_ros.records import Recording
from tf2_ros_tools.diagnosis.findings import Finding
from tf2_ros_tools.listening.session import TOPICS, publisher_name

GID_BYTES = 16  # of a gid in a recording; in the graph of Humble, zeros follow them
TYPE = "tf2_msgs/msg/TFMessage"
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # of an endpoint whose node the graph does not know yet, or any more


class NodeSession:
    """A :class:`~tf2_ros_tools.listening.session.Session` of a node."""

    def __init__(self, node: Node, buffer: Buffer, topics: tuple[str, str]) -> None:
        self.buffer = buffer
        self.names: dict[bytes, str] = {}
        self.feed = None
        self._node = node
        self._topics = [node.resolve_topic_name(name) for name in topics]

    @property
    def where(self) -> str:
        """The topics, and, while nothing was received, what is published instead."""
        where = f"on {' and '.join(self._topics)} in ROS domain {self._node.context.get_domain_id()}"
        instead = [] if self.buffer.frames() else [*self._of_other_types(), *self._in_other_namespaces()]
        return f"{where} ({'; '.join(instead)})" if instead else where

    def now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def require_open(self) -> None:
        """Nothing ends a node but a signal."""

    def info(self, text: str) -> None:
        self._node.get_logger().info(text)

    def same_publishers(self, ids: Sequence[bytes]) -> None:
        """Return None: an id is a gid."""

    def log_no_refusals(self) -> None:
        set_logger_level("tf2_py", LoggingSeverity.FATAL)

    def look_up_publishers(self) -> set[bytes]:
        return {gid for topic in self._topics for gid in self._publishers_of(topic)}

    def clock_publishers(self) -> list[str]:
        return [publisher_name(self.names, gid) for gid in self._publishers_of("/clock")]

    def findings(self) -> Iterator[Finding]:
        """Find publishers from which listeners receive nothing."""
        if self.buffer.frames():  # else `where` says so
            for text in self._of_other_types():
                yield Finding("qos", "", f"listeners receive nothing: {text}")
        for subscription in self._node.subscriptions:
            if (topic := subscription.topic_name) in self._topics:
                for gid, qos in self._publishers_of(topic).items():
                    compatibility, reasons = qos_check_compatible(qos, subscription.qos_profile)
                    if compatibility == QoSCompatibility.ERROR:
                        errors = ", ".join(re.findall("ERROR: ([^;]+)", reasons)).lower()
                        name = publisher_name(self.names, gid)
                        yield Finding(
                            "qos", "", f"listeners receive nothing from {name} on {topic}: {errors}"
                        )

    def _of_other_types(self) -> Iterator[str]:
        for topic in self._topics:
            self._publishers_of(topic)  # notes the names
            for one in self._node.get_publishers_info_by_topic(topic):
                if one.topic_type != TYPE:
                    name = publisher_name(self.names, bytes(one.endpoint_gid)[:GID_BYTES])
                    yield f"{name} publishes {one.topic_type} on {topic}, not {TYPE}"

    def _in_other_namespaces(self) -> Iterator[str]:
        usual, own = TOPICS[0], self._topics[0]
        for name, types in self._node.get_topic_names_and_types():
            is_other = name != own and name.endswith(usual) and own.endswith(usual) and TYPE in types
            if is_other and self._node.count_publishers(name):
                namespace = name[1 : -len(usual)]
                advice = f"add --namespace {namespace}" if namespace else "leave --namespace out"
                yield f"transforms are published on {name}: {advice}"

    def _publishers_of(self, topic: str) -> dict[bytes, QoSProfile]:
        """Get the gids and profiles of a topic's publishers, and note their names."""
        publishers = self._node.get_publishers_info_by_topic(topic)
        infos = {bytes(one.endpoint_gid)[:GID_BYTES]: one for one in publishers}
        for gid, one in infos.items():
            # A publisher that has exited keeps its name.
            if one.node_name != UNKNOWN_NODE:
                self.names[gid] = f"{one.node_namespace.rstrip('/')}/{one.node_name}"
        return {gid: one.qos_profile for gid, one in infos.items()}


@contextmanager
def node_session(
    name: str,
    options: Namespace,
    recording: Recording | None = None,
    *,
    topics: tuple[str, str] = TOPICS,
    cache_time: float | None = None,
    qos: QoSProfile | None = None,
) -> Iterator[NodeSession]:
    """A session of a new node, see :func:`tf2_ros_tools.listening.session_choice.session`."""
    with (
        spun_node(name, options) as node,
        filled_buffer(node, recording, topics=topics, cache_time=cache_time, qos=qos) as buffer,
    ):
        yield NodeSession(node, buffer, topics)
