# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Make nodes that are not the program's: hidden from its command line, and without services."""

from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from tf2_ros._process.forking import keep_in_children


def hidden_node(prefix: str, owner: object, **options: Any) -> Node:
    """
    Make a node whose name begins with ``prefix`` and is unique in this process while ``owner`` lives.

    Nothing in it depends on ROS time, and programs do not configure it. So it has no services,
    does not log to /rosout, and does not use simulated time. The command line's rules for namespaces and
    topics apply to it, but not those for names, with which launch files rename the program's own node.
    """
    name = f"{prefix}_{id(owner):010x}"
    node = Node(
        name,
        **options,
        cli_args=["--ros-args", "-r", f"__node:={name}"],  # a node's own rules precede those of the process
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[
            Parameter("use_sim_time", value=False),
            # rclpy never frees this service: 107 kB for each node.
            Parameter("start_type_description_service", value=False),
        ],
    )
    keep_in_children(node)  # also if nothing uses it because what its owner does next fails
    return node


def companion_node(prefix: str, owner: object, node: Any) -> Node:
    """Make a hidden node in the context and the namespace of another one."""
    return hidden_node(
        prefix, owner, context=node.context, namespace=node.get_namespace(), use_global_arguments=False
    )
