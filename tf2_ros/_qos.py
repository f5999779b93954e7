"""Owns the quality of service of /tf, /tf_static and the lookup action, and what parameters may override."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

__all__ = [
    "dynamic_broadcaster_qos",
    "dynamic_overrides",
    "listener_qos",
    "lookup_qos",
    "static_broadcaster_qos",
    "static_listener_qos",
    "static_overrides",
]

# Functions, for rclpy writes the overrides into the profile it is given.


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


def dynamic_overrides() -> QoSOverridingOptions:
    return QoSOverridingOptions(
        [QoSPolicyKind.DEPTH, QoSPolicyKind.DURABILITY, QoSPolicyKind.HISTORY, QoSPolicyKind.RELIABILITY]
    )


def static_overrides() -> QoSOverridingOptions:
    # Without its durability /tf_static would be a topic like any other.
    return QoSOverridingOptions([QoSPolicyKind.DEPTH, QoSPolicyKind.HISTORY, QoSPolicyKind.RELIABILITY])
