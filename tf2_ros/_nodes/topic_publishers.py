# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ask the graph for the publishers of a topic, and for what is published instead."""

from collections.abc import Iterator
from typing import Any

from rclpy.node import Node

from tf2_py.printable import printable
from tf2_ros._nodes.ended_nodes import suppress_at_end

TYPE = "tf2_msgs/msg/TFMessage"
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # until the graph knows the node of an endpoint


def clock_publishers(node: Node | None) -> list[str]:
    """The names of the nodes that publish /clock, as many as there are publishers."""
    return sorted(map(publisher_name, publishers_of(node, "/clock")))


def publisher_ids(node: Node, topic: str) -> set[bytes]:
    """The identifiers of the publishers of a topic, also of a killed one until the middleware notices."""
    return {bytes(publisher.endpoint_gid) for publisher in publishers_of(node, topic)}


def published_instead(node: Node, topic: str) -> Iterator[str]:
    """
    Say what is published instead of transforms on a topic: messages of another type, or transforms on a topic
    of the same name in another namespace. Clauses without commas.
    """
    last = topic[topic.rindex("/") :]
    with suppress_at_end(node):
        for name, types in node.get_topic_names_and_types():
            if name == topic and types != [TYPE]:
                for one in publishers_of(node, topic):
                    if one.topic_type != TYPE:
                        yield f"{publisher_name(one)} publishes {one.topic_type} there"
            elif name.endswith(last) and TYPE in types and name != topic and node.count_publishers(name):
                namespace = name[1 : -len(last)]
                is_usual = last == "/tf" and namespace
                command = f" to a node or --namespace {namespace} to a command" if is_usual else ""
                yield f"transforms are published on {name}: add --ros-args -r {topic}:={name}{command}"


def publishers_of(node: Node | None, topic: str) -> list[Any]:
    """The endpoints that publish a topic; none for a node that has ended."""
    if node is not None:
        with suppress_at_end(node):
            return list(node.get_publishers_info_by_topic(topic))
    return []


def publisher_name(publisher: Any) -> str:
    """The full name of the node of an endpoint, for texts."""
    if publisher.node_name == UNKNOWN_NODE:
        return "an unknown node"
    return printable(f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}")
