# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Name the publishers whose QoS is incompatible with a subscription."""

import weakref
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible

from tf2_ros._nodes.topic_publishers import UNKNOWN_NODE, publisher_name, publishers_of
from tf2_ros._process.background import check_regularly
from tf2_ros._rclpy import call_after, event_handlers

NAME_CHECKS = 2  # how many regular checks to wait for a name; the first may come at once


def name_incompatible_publishers(node: Node, subscription: Any) -> None:
    """When publishers do not fit a subscription, log their names: rclpy's own warning has only the topic."""
    for handler in event_handlers(subscription):
        call_after(handler, partial(_IncompatiblePublishers, node, subscription))


class _IncompatiblePublishers:
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
        for publisher in publishers_of(self._node(), self._topic):
            compatibility, reasons = qos_check_compatible(publisher.qos_profile, self._qos)
            if compatibility == QoSCompatibility.ERROR:
                errors = [part[len("ERROR: ") :] for part in reasons.split(";") if part.startswith("ERROR: ")]
                yield bytes(publisher.endpoint_gid), publisher, ", ".join(errors)

    def _warn(self, identifier: bytes, publisher: Any, reason: str, checks_left: int) -> None:
        node = self._node()
        if publisher.node_name == UNKNOWN_NODE and checks_left:
            self._unnamed[identifier] = checks_left
        elif node is not None:
            text = f"Nothing is received from {publisher_name(publisher)} on {self._topic}: {reason}"
            node.get_logger().warning(text)
