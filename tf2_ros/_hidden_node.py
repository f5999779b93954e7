"""Owns the nodes that a program does not see: those of a listener without a node, and of a buffer client."""

from typing import Any

from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

__all__ = ["hidden_node"]


def hidden_node(
    prefix: str,
    owner: object,
    *,
    context: Context | None = None,
    namespace: str | None = None,
    use_global_arguments: bool = True,
) -> Node:
    """
    Make a node whose name begins with ``prefix`` and is unique in this process while ``owner`` lives.

    Nothing of it depends on ROS time, and programs do not configure it: it has no services of its own, does
    not log to /rosout, and does not use simulated time.
    """
    options: dict[str, Any] = {"context": context, "namespace": namespace}
    return Node(
        f"{prefix}_{id(owner):010x}",
        **options,
        use_global_arguments=use_global_arguments,
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[
            Parameter("use_sim_time", value=False),
            # rclpy never frees this service: 107 kB for each node.
            Parameter("start_type_description_service", value=False),
        ],
    )
