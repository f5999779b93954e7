"""Name the publishers of a topic, where what they do affects listeners and buffers."""

import weakref
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

from tf2_ros._rclpy import event_handlers
from tf2_ros_cython.output import printable

UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # until the graph knows the node of an endpoint


def clock_publishers(node: Node | None) -> list[str]:
    """The names of the nodes that publish /clock, as many as there are publishers."""
    return sorted(map(_name, _publishers(node, "/clock")))


def name_unfit_publishers(node: Node, subscription: Any) -> None:
    """When publishers do not fit a subscription, log their names: rclpy's own warning has only the topic."""
    for handler in event_handlers(subscription):
        handler.callback = partial(
            _on_event, weakref.ref(node), subscription.topic_name, subscription.qos_profile, handler.callback
        )


def _on_event(
    node: "weakref.ref[Node]", topic: str, qos: QoSProfile, callback: Callable[[Any], Any], event: Any
) -> None:
    callback(event)
    listening = node()
    for one in _publishers(listening, topic):
        compatibility, reasons = qos_check_compatible(one.qos_profile, qos)
        if listening is not None and compatibility == QoSCompatibility.ERROR:
            errors = [part[len("ERROR: ") :] for part in reasons.split(";") if part.startswith("ERROR: ")]
            text = f"Nothing is received from {_name(one)} on {topic}: {', '.join(errors)}"
            listening.get_logger().warning(text)


def _publishers(node: Node | None, topic: str) -> list[Any]:
    with suppress(InvalidHandle):  # the node was destroyed
        if node is not None:
            return list(node.get_publishers_info_by_topic(topic))
    return []


def _name(publisher: Any) -> str:
    if publisher.node_name == UNKNOWN_NODE:
        return "an unknown node"
    return printable(f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}")
