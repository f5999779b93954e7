# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Name the publishers of a topic, where what they do affects listeners and buffers."""

import weakref
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible

from tf2_py.printable import printable
from tf2_ros._nodes.ended_nodes import suppress_at_end
from tf2_ros._process.background import check_regularly
from tf2_ros._rclpy import call_after, event_handlers

TYPE = "tf2_msgs/msg/TFMessage"
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # until the graph knows the node of an endpoint
NAME_CHECKS = 2  # how many regular checks to wait for a name; the first may come at once


def clock_publishers(node: Node | None) -> list[str]:
    """The names of the nodes that publish /clock, as many as there are publishers."""
    return sorted(map(_name, _publishers(node, "/clock")))


def publisher_ids(node: Node, topic: str) -> set[bytes]:
    """The identifiers of the publishers of a topic, also of a killed one until the middleware notices."""
    return {bytes(publisher.endpoint_gid) for publisher in _publishers(node, topic)}


def published_instead(node: Node, topic: str) -> Iterator[str]:
    """
    Say what is published instead of transforms on a topic: messages of another type, or transforms on a topic
    of the same name in another namespace. Clauses without commas.
    """
    last = topic[topic.rindex("/") :]
    with suppress_at_end(node):
        for name, types in node.get_topic_names_and_types():
            if name == topic and types != [TYPE]:
                for one in _publishers(node, topic):
                    if one.topic_type != TYPE:
                        yield f"{_name(one)} publishes {one.topic_type} there"
            elif name.endswith(last) and TYPE in types and name != topic and node.count_publishers(name):
                namespace = name[1 : -len(last)]
                is_usual = last == "/tf" and namespace
                command = f" to a node or --namespace {namespace} to a command" if is_usual else ""
                yield f"transforms are published on {name}: add --ros-args -r {topic}:={name}{command}"


def name_incompatible_publishers(node: Node, subscription: Any) -> None:
    """When publishers do not fit a subscription, log their names: rclpy's own warning has only the topic."""
    for handler in event_handlers(subscription):
        call_after(handler, partial(_UnfitPublishers, node, subscription))


class _UnfitPublishers:
    """The callback of an event handler of a subscription; it calls the former one first."""

    def __init__(self, node: Node, subscription: Any, former: Callable[[Any], Any]) -> None:
        self._node = weakref.ref(node)
        self._topic, self._qos, self._former = subscription.topic_name, subscription.qos_profile, former
        # Identifiers of publishers, and for how many more checks to wait.
        self._unnamed: dict[bytes, int] = {}
        check_regularly(self)

    def __call__(self, event: Any) -> None:
        self._former(event)
        for identifier, publisher, reason in self._incompatible():
            self._warn(identifier, publisher, reason, NAME_CHECKS)

    def _tf2_check(self) -> None:
        unnamed, self._unnamed = self._unnamed, {}
        if unnamed:
            for identifier, publisher, reason in self._incompatible():
                if identifier in unnamed:
                    self._warn(identifier, publisher, reason, unnamed[identifier] - 1)

    def _incompatible(self) -> Iterator[tuple[bytes, Any, str]]:
        for publisher in _publishers(self._node(), self._topic):
            compatibility, reasons = qos_check_compatible(publisher.qos_profile, self._qos)
            if compatibility == QoSCompatibility.ERROR:
                errors = [part[len("ERROR: ") :] for part in reasons.split(";") if part.startswith("ERROR: ")]
                yield bytes(publisher.endpoint_gid), publisher, ", ".join(errors)

    def _warn(self, identifier: bytes, publisher: Any, reason: str, checks_left: int) -> None:
        node = self._node()
        if publisher.node_name == UNKNOWN_NODE and checks_left:
            self._unnamed[identifier] = checks_left
        elif node is not None:
            text = f"Nothing is received from {_name(publisher)} on {self._topic}: {reason}"
            node.get_logger().warning(text)


def _publishers(node: Node | None, topic: str) -> list[Any]:
    if node is not None:
        with suppress_at_end(node):
            return list(node.get_publishers_info_by_topic(topic))
    return []


def _name(publisher: Any) -> str:
    if publisher.node_name == UNKNOWN_NODE:
        return "an unknown node"
    return printable(f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}")
