# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Mistakes of a user: mypy --strict and pyright report the lines marked with `wrong`, and no others.

For mypy, a message without stubs is Any: it misses those that are marked `for pyright`.
"""

from geometry_msgs.msg import PointStamped, PoseStamped, TransformStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import Imu

import tf2_ros
from tf2_geometry_msgs import do_transform_pose_stamped
from tf2_py.typing import DurationLike, TimeLike
from tf2_ros import (
    Buffer,
    BufferClient,
    BufferCore,
    BufferServer,
    MessageFilter,
    Stamped,
    TransformBroadcaster,
    TransformListener,
    TransformRegistration,
    convert,
)
from tf2_ros.numpy import from_matrix, to_arrays, to_matrix


def arguments(buffer: Buffer, pose: PoseStamped) -> None:
    """Times, timeouts and the order of arguments."""
    buffer.lookup_transform("a", "b", pose.header)  # wrong for pyright
    buffer.lookup_transform("a", "b", 1.5)  # wrong: nanoseconds are an int
    buffer.lookup_transform("a", "b", Time(), "1 s")  # wrong
    buffer.lookup_transform("a", "b")  # wrong: there is no default time
    buffer.lookup_transform("a", Time(), "b")  # wrong: the order of lookup_transform_full
    buffer.lookup_transform_full("a", "b", Time(), Time(), "c")  # wrong
    buffer.lookup_transform("a", "b", tme=Time())  # wrong
    buffer.lookup_transforms("a", "b", [1], on_missing="skip")  # wrong
    buffer.lookup_matrix("a", "b", 1, [[0.0] * 4] * 4)  # wrong: the matrix would not arrive in the lists
    time: TimeLike = 0.5  # wrong
    timeout: DurationLike = "0.5"  # wrong
    print(time, timeout)
    print(Buffer("10"))  # wrong: how far back is a duration, or seconds
    print(Buffer(max_framse=10))  # wrong
    buffer.transform(pose, target="map")  # wrong
    buffer.set_transform(pose, "somebody")  # wrong for pyright


def results(buffer: Buffer, client: BufferClient, pose: PoseStamped) -> None:
    """What functions return."""
    can, reason = buffer.can_transform("a", "b", Time())  # wrong
    print(can, reason, client.can_transform_full("a", Time(), "b", Time(), "c")[1])  # wrong
    print(buffer.lookup_transforms("a", "b", [1]).translations)  # wrong: it is a tuple
    print(buffer.transform(pose, "map").pose.positoin)  # wrong for pyright
    print(buffer.transform(pose, "map", new_type=PointStamped).pose)  # wrong for pyright
    print(buffer.lookup_transform("a", "b", Time()).translation)  # wrong for pyright
    print(buffer.statistics()["token"])  # wrong
    print(convert(pose, PointStamped).pose)  # wrong for pyright
    print(Stamped(pose, 1.5, "map"))  # wrong
    print(from_matrix(to_matrix(pose)).pose)  # wrong for pyright
    print(to_arrays([pose]).shape)  # wrong
    print(do_transform_pose_stamped(PointStamped(), TransformStamped()))  # wrong for pyright
    buffer.lookup_transfrom("a", "b", Time())  # wrong


async def coroutines(buffer: Buffer, pose: PoseStamped) -> None:
    """What is awaited."""
    print((await buffer.transform_async(pose, "map")).point)  # wrong for pyright
    print((await buffer.wait_for_transform_async("a", "b", Time())).translation)  # wrong for pyright
    print(buffer.lookup_transform_async("a", "b", Time()).transform)  # wrong: it was not awaited
    buffer.wait_for_transform_async("a", "b", Time()).add_done_callback(1)  # wrong
    buffer.on_change("a", "b", print).stop()  # wrong
    buffer.on_change("a", "b", print, max_gap={"b": 1.0})  # wrong


def takes_imu(message: Imu) -> None:
    """A callback for another type."""
    print(message.orientation)


async def filters(buffer: Buffer, node: Node) -> None:
    """A filter of points."""
    points = MessageFilter((PointStamped, "points", 10), buffer, "map", 10, node=node)
    points.registerCallback(takes_imu)  # wrong for pyright
    points.registerFailureCallback(takes_imu)  # wrong
    points.add(PoseStamped())  # wrong for pyright
    async for message, transform in points:
        print(message.pose, transform)  # wrong for pyright
    MessageFilter((PointStamped, "points"), buffer, "map", 10, node=node)  # wrong
    MessageFilter(None, BufferCore(), "map", 10, node=node)  # wrong
    MessageFilter(None, buffer, "map", 10, node=node, policy={"timeout": 1.0})  # wrong


def nodes(buffer: Buffer, node: Node, pose: PoseStamped) -> None:
    """Listeners, broadcasters, servers, and functions by type."""
    TransformListener(node, buffer)  # wrong: the buffer comes first
    TransformListener(buffer, node, True)  # wrong: only by keyword
    TransformBroadcaster(node).sendTransform([pose])  # wrong for pyright
    BufferServer(node, buffer, "server")  # wrong
    tf2_ros.Bufer()  # wrong
    BufferClient(node, "server", timeout_padding=Duration).destroy()  # wrong
    BufferClient(node, "server").lookup_transform("a", "b", Time(), maxage=1.0)  # wrong
    TransformRegistration().add(Imu, do_transform_pose_stamped)  # wrong for pyright
