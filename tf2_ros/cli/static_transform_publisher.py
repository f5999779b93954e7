"""Owns the program that publishes static transforms."""

import sys

from tf2_ros_cython.cli.static_transform_publisher import main, transforms_of

if __name__ == "__main__":  # before what needs ROS: `main` says in one line what is missing
    sys.exit(main())

from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

import secrets
import string
from argparse import Namespace
from contextlib import suppress
from typing import Any

from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from tf2_ros.cli._node import spun_node
from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster
from tf2_ros_cython.cli._program import SUCCESS, deferred_signals, wait_for_signal
from tf2_ros_cython.cli._static_transforms import StaticTransform

__all__ = ["main", "publish"]


def publish(options: Namespace) -> int:
    """Publish until interrupted; return the exit status."""
    transforms = transforms_of(options)
    with suppress(KeyboardInterrupt), spun_node(_unique_name(), options) as node, deferred_signals():
        if options.file is None:
            _declare_parameters(node, transforms[0])
        _warn(node, options, transforms)
        stamp = node.get_clock().now().to_msg()
        StaticTransformBroadcaster(node).sendTransform([_message(one, stamp) for one in transforms])
        node.get_logger().info(_summary(options, transforms))
        wait_for_signal()
    return SUCCESS


def _unique_name() -> str:
    # Many of them run on one robot.
    end = "".join(secrets.choice(string.ascii_letters + string.digits) for _ in range(16))
    return f"static_transform_publisher_{end}"


def _declare_parameters(node: Node, transform: StaticTransform) -> None:
    """By these, others can ask the node what it publishes; the command line alone sets them."""
    (x, y, z), (qx, qy, qz, qw) = transform.translation, transform.rotation
    values: dict[str, Any] = {
        "translation.x": x,
        "translation.y": y,
        "translation.z": z,
        "rotation.x": qx,
        "rotation.y": qy,
        "rotation.z": qz,
        "rotation.w": qw,
        "frame_id": transform.frame_id,
        "child_frame_id": transform.child_frame_id,
    }
    for name, value in values.items():
        node.declare_parameter(name, value, ParameterDescriptor(read_only=True), ignore_override=True)


def _warn(node: Node, options: Namespace, transforms: list[StaticTransform]) -> None:
    log = node.get_logger()
    if options.old:
        log.warning("Old-style arguments are deprecated; see --help for new-style arguments")
    for one in transforms:
        if one.was_normalised:
            log.warning(
                f"The quaternion of {one.child_frame_id} does not have length one; what is published does: "
                f"{one.rotation}"
            )


def _message(transform: StaticTransform, stamp: Any) -> TransformStamped:
    message = TransformStamped(child_frame_id=transform.child_frame_id)
    message.header.frame_id = transform.frame_id
    message.header.stamp = stamp
    message.transform.translation = Vector3(**dict(zip("xyz", transform.translation, strict=True)))
    message.transform.rotation = Quaternion(**dict(zip("xyzw", transform.rotation, strict=True)))
    return message


def _summary(options: Namespace, transforms: list[StaticTransform]) -> str:
    if options.file is not None:
        return f"Spinning until stopped - publishing {len(transforms)} transforms of {options.file}"
    [one] = transforms
    return (
        "Spinning until stopped - publishing transform\n"
        f"translation: {_quoted(one.translation)}\n"
        f"rotation: {_quoted(one.rotation)}\n"
        f"from '{one.frame_id}' to '{one.child_frame_id}'"
    )


def _quoted(numbers: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"'{number:f}'" for number in numbers) + ")"
