"""Quality of service of /tf, /tf_static and the lookup action, and what parameters may override."""

from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from tf2_ros._rclpy import parameter_overrides

_DYNAMIC_POLICIES = [
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.DURABILITY,
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.RELIABILITY,
]
# Without its durability /tf_static would be a topic like any other.
_STATIC_POLICIES = [QoSPolicyKind.DEPTH, QoSPolicyKind.HISTORY, QoSPolicyKind.RELIABILITY]


def chosen_qos(
    node: Node, topic: str, kind: str, given: QoSProfile | int | None, *, is_static: bool
) -> tuple[QoSProfile | int, dict[str, Any]]:
    """
    Choose the profile of a topic of transforms.

    :param kind: ``publisher`` or ``subscription``.
    :param given: what the program has chosen, or None.
    :return: the profile, and the keyword that lets parameters of the node override a default profile.
    """
    if given is not None:
        return given, {}
    # One message has all static transforms of a node, so a late subscriber needs only the last one.
    depth = 1 if is_static and kind == "publisher" else 100
    durability = DurabilityPolicy.TRANSIENT_LOCAL if is_static else DurabilityPolicy.VOLATILE
    # A new profile each time, because rclpy writes the overrides into it.
    profile = QoSProfile(depth=depth, history=HistoryPolicy.KEEP_LAST, durability=durability)
    return profile, _overrides(node, topic, kind, _STATIC_POLICIES if is_static else _DYNAMIC_POLICIES)


def lookup_qos() -> QoSProfile:
    # One transform may answer many goals at once; the usual queue of ten would lose the first answers.
    return QoSProfile(history=HistoryPolicy.KEEP_ALL)


def _overrides(node: Node, topic: str, kind: str, policies: list[QoSPolicyKind]) -> dict[str, Any]:
    # rclpy declares a parameter for each policy, and a program's parameter callbacks may refuse unknown ones.
    # So this is used only if the node was started with such a parameter.
    given = parameter_overrides(node)
    if not any(name.startswith("qos_overrides.") for name in given):
        return {}
    prefix = f"qos_overrides.{node.resolve_topic_name(topic)}.{kind}."
    if not any(name.startswith(prefix) for name in given):
        return {}
    return {"qos_overriding_options": QoSOverridingOptions(policies)}
