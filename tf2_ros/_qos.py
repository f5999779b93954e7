"""Owns the quality of service of /tf, /tf_static and the lookup action, and what parameters may override."""

from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from tf2_ros._rclpy import parameter_overrides

__all__ = [
    "dynamic_broadcaster_qos",
    "dynamic_overrides",
    "listener_qos",
    "lookup_qos",
    "static_broadcaster_qos",
    "static_listener_qos",
    "static_overrides",
]

_DYNAMIC_POLICIES = [
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.DURABILITY,
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.RELIABILITY,
]
# Without its durability /tf_static would be a topic like any other.
_STATIC_POLICIES = [QoSPolicyKind.DEPTH, QoSPolicyKind.HISTORY, QoSPolicyKind.RELIABILITY]

# Functions, because rclpy writes the overrides into the profile it is given.


def listener_qos() -> QoSProfile:
    return QoSProfile(depth=100, history=HistoryPolicy.KEEP_LAST, durability=DurabilityPolicy.VOLATILE)


def static_listener_qos() -> QoSProfile:
    return QoSProfile(depth=100, history=HistoryPolicy.KEEP_LAST, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def dynamic_broadcaster_qos() -> QoSProfile:
    return QoSProfile(depth=100, history=HistoryPolicy.KEEP_LAST, durability=DurabilityPolicy.VOLATILE)


def static_broadcaster_qos() -> QoSProfile:
    # One message holds every static transform of a node, so a late subscriber needs the last one alone.
    return QoSProfile(depth=1, history=HistoryPolicy.KEEP_LAST, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def lookup_qos() -> QoSProfile:
    # One transform may answer many goals at once; in the usual queue of ten the first answers would be lost.
    return QoSProfile(history=HistoryPolicy.KEEP_ALL)


def dynamic_overrides(node: Node, topic: str, kind: str) -> dict[str, Any]:
    """The keyword that lets the node's parameters override the default profile of a dynamic topic."""
    return _overrides(node, topic, kind, _DYNAMIC_POLICIES)


def static_overrides(node: Node, topic: str, kind: str) -> dict[str, Any]:
    """The same for a static topic; ``kind`` is 'publisher' or 'subscription'."""
    return _overrides(node, topic, kind, _STATIC_POLICIES)


def _overrides(node: Node, topic: str, kind: str, policies: list[QoSPolicyKind]) -> dict[str, Any]:
    # rclpy declares a parameter for each policy, and a program's parameter callbacks may refuse unknown ones.
    # So this is used only where the node was started with such a parameter.
    given = parameter_overrides(node)
    if not any(name.startswith("qos_overrides.") for name in given):
        return {}
    prefix = f"qos_overrides.{node.resolve_topic_name(topic)}.{kind}."
    if not any(name.startswith(prefix) for name in given):
        return {}
    return {"qos_overriding_options": QoSOverridingOptions(policies)}
