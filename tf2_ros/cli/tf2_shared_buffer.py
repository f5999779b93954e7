"""Owns the program that listens for all processes of a machine."""

import sys

from tf2_ros_cython.cli.tf2_shared_buffer import main

if __name__ == "__main__":  # before what needs ROS: `main` says in one line what is missing
    sys.exit(main())

from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

import os
from argparse import Namespace
from contextlib import suppress

from rclpy.node import Node

from tf2_ros._shared.names import SharedBufferError, buffer_name
from tf2_ros.buffer import Buffer
from tf2_ros.cli._node import spun_node
from tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC, TransformListener
from tf2_ros_cython.cli._program import (
    SUCCESS,
    RunError,
    UsageError,
    deferred_signals,
    wait_for_signal,
)

__all__ = ["main", "share"]


def share(options: Namespace) -> int:
    """Listen, and share what is received, until interrupted; return the exit status."""
    _refuse_wrong_name(options.name)
    with suppress(KeyboardInterrupt), spun_node("tf2_shared_buffer", options) as node, deferred_signals():
        domain = node.context.get_domain_id()
        name = buffer_name(options.name, domain)
        buffer = _shared_buffer(name, options.cache_time, node)
        with TransformListener(buffer, node):
            topics = " and ".join(map(node.resolve_topic_name, (DEFAULT_TF_TOPIC, DEFAULT_STATIC_TF_TOPIC)))
            node.get_logger().info(
                f"Sharing {topics} of ROS domain {domain} as {name!r}: process {os.getpid()}, "
                f"keeps {buffer.cache_time_ns / 1e9:g} s"
            )
            wait_for_signal()
    return SUCCESS


def _refuse_wrong_name(name: str) -> None:
    try:
        buffer_name(name)
    except ValueError as refusal:
        raise UsageError(str(refusal)) from None


def _shared_buffer(name: str, cache_time: float | None, node: Node) -> Buffer:
    try:
        return Buffer(cache_time, node, share=name)
    except (SharedBufferError, NotImplementedError) as failure:  # the second is not on Linux
        raise RunError(str(failure)) from None
