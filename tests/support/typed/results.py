# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The types of results in a user's program: mypy --strict and pyright accept it."""

from typing import Any

import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Time as TimeMsg
from geometry_msgs.msg import Point, PointStamped, PoseStamped, Transform, TransformStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import Imu, PointCloud2, PointField
from std_msgs.msg import Header
from typing_extensions import assert_type

import tf2_geometry_msgs
import tf2_ros
from tf2_geometry_msgs import do_transform_odometry, do_transform_point
from tf2_py.typing import DurationLike, HasNanoseconds, HasSecNanosec, LookupPolicy, TimeLike
from tf2_ros import (
    Buffer,
    BufferClient,
    BufferCore,
    BufferInterface,
    ConvertRegistration,
    Explanation,
    FilterFailureReason,
    FrameInfo,
    History,
    Hop,
    MessageFilter,
    Stamped,
    TransformRegistration,
    convert,
)
from tf2_ros.numpy import from_matrix, to_arrays, to_columns, to_matrix
from tf2_sensor_msgs import deskew, do_transform_imu
from tf2_sensor_msgs.tf2_sensor_msgs import create_cloud, read_points

Floats = npt.NDArray[np.float64]
Twist = tuple[tuple[float, float, float], tuple[float, float, float]]


def times(stamp: TimeMsg, header: Header) -> list[TimeLike]:
    """Every kind of time."""
    counted: HasNanoseconds = Time(nanoseconds=1)
    parted: HasSecNanosec = stamp
    print(parted.sec + parted.nanosec)
    return [Time(), stamp, header.stamp, counted, parted, 1_000_000_000, np.datetime64(1, "ns")]


def timeouts() -> list[DurationLike]:
    """Every kind of timeout."""
    return [Duration(seconds=1.0), Duration().to_msg(), 0.5, 1]


def core(message: TransformStamped, data: bytes, when: TimeLike, interval: DurationLike) -> None:
    """A BufferCore, filled and asked."""
    buffer = BufferCore(Duration(seconds=10), max_frames=10, max_bytes=1 << 20)
    assert_type(buffer.set_transforms([message], "somebody", static=True), int)
    assert_type(buffer.set_transforms([message], "somebody", replace=True), int)
    buffer.set_transform(message, "somebody", replace=True)
    assert_type(buffer.set_transforms_cdr(data, "somebody"), int)
    assert_type(buffer.can_transform_core("a", "b", when), tuple[int, str])
    assert_type(buffer.get_latest_common_time("a", "b").nanoseconds, int)
    assert_type(buffer.lookupVelocityCore("a", "b", when, interval), Twist)
    assert_type(buffer.statistics()["refused"]["REFUSED_NAN"], int)
    assert_type(buffer.time_range("a", "b"), tuple[int, int])
    assert_type(buffer.ages("a", "b"), dict[str, float])
    facts: FrameInfo = buffer.frames()["a"]
    assert_type(facts.oldest_ns or facts.newest_ns, int | None)
    explained: Explanation = buffer.explain("a", "b", when, tolerance=0.5)
    assert_type(explained.hops, list[Hop])
    assert_type(explained.hops[0].older_ns, int | None)
    assert_type(explained.weakest, Hop | None)
    history: History = buffer.histories()["a"]
    assert_type(history.stamps_ns, npt.NDArray[np.int64])


def series(buffer: Buffer, points: npt.NDArray[np.float32]) -> None:
    """Many lookups at once."""
    many = np.array([1, 2])
    assert_type(
        buffer.lookup_transforms("a", ["b", "c"], [TimeMsg()], on_missing="nan"), tuple[Floats, Floats]
    )
    assert_type(buffer.lookup_matrices("a", "b", many, fixed_frame="c", target_time=Time()), Floats)
    assert_type(buffer.lookup_matrix("a", "b", Time(), max_gap=0.1), Floats)
    assert_type(buffer.lookup_matrix("a", "b", 1, points[:4, :4]), npt.NDArray[np.float32])
    assert_type(buffer.transform_points(points, many, "a", "b"), npt.NDArray[np.float32])
    assert_type(buffer.transform_points([[1.0, 2.0, 3.0]], many, "a", "b"), Floats)


def policies(buffer: Buffer, policy: LookupPolicy) -> None:
    """What a lookup in a Buffer accepts besides."""
    assert_type(buffer.lookup_transform("a", "b", 1, **policy), TransformStamped)
    ages: dict[str, float] = {"a": 1.0}
    assert_type(buffer.lookup_transform("a", "b", 0, max_age=ages, tolerance=ages), TransformStamped)
    assert_type(buffer.can_transform("a", "b", 0, max_age=0.5), bool)


def lookups(buffer: Buffer | BufferClient, message: PoseStamped, timeout: DurationLike) -> None:
    """The lookups of a Buffer and of a BufferClient."""
    stamp = message.header.stamp
    assert_type(buffer.lookup_transform("a", "b", stamp, timeout), TransformStamped)
    assert_type(buffer.lookup_transform_full("a", Time(), "b", stamp, "c", timeout), TransformStamped)
    assert_type(buffer.can_transform("a", "b", stamp, timeout), bool)
    assert_type(buffer.can_transform("a", "b", stamp, return_debug_tuple=True), tuple[bool, str])
    assert_type(buffer.can_transform_full("a", stamp, "b", stamp, "c", timeout), bool)
    assert_type(buffer.can_transform_full("a", stamp, "b", stamp, "c", timeout, True), tuple[bool, str])
    assert_type(buffer.lookup_transform("a", "b", Time(), timeout, max_age=0.5), TransformStamped)


def transforms(buffer: BufferInterface, message: PoseStamped, timeout: DurationLike) -> None:
    """What goes in comes out, or what `new_type` says."""
    assert_type(buffer.transform(message, "a"), PoseStamped)
    assert_type(buffer.transform(message, "a", timeout, PointStamped), PointStamped)
    assert_type(buffer.transform(message, "a", prefix="robot1/"), PoseStamped)
    assert_type(buffer.transform_full(message, "a", Time(), "b"), PoseStamped)
    assert_type(buffer.transform_full(message, "a", Time(), "b", timeout, PointStamped), PointStamped)


async def coroutines(
    buffer: Buffer, client: BufferClient, message: PoseStamped, policy: LookupPolicy
) -> None:
    """What is awaited."""
    stamp = message.header.stamp
    for owner in (buffer, client):
        assert_type(await owner.lookup_transform_async("a", "b", stamp), TransformStamped)
        full = owner.lookup_transform_full_async("a", stamp, "b", stamp, "c", timeout=1.0)
        assert_type(await full, TransformStamped)
        assert_type(await owner.transform_async(message, "a", 1.5), PoseStamped)
        assert_type(await owner.transform_async(message, "a", new_type=PointStamped), PointStamped)
    future = buffer.wait_for_transform_async("a", "b", stamp, timeout=Duration(seconds=1))
    future.add_done_callback(lambda done: print(done.result()))
    assert_type(future.exception(), BaseException | None)
    assert_type(future.result(), TransformStamped)
    assert_type(await future, TransformStamped)
    async for transform in buffer.changes("a", "b"):
        assert_type(transform, TransformStamped)
    buffer.changes("a", "b", max_age={"b": 1.0}, max_gap=1.5)
    buffer.on_change("a", "b", print, max_age=0.5, max_gap=Duration(seconds=1)).cancel()


def with_number(message: PointStamped, number: int) -> None:
    """A callback with an argument of its own."""
    print(message.point.x, number)


def dropped(message: PointStamped, reason: FilterFailureReason) -> None:
    """A callback for failures."""
    print(message.header.frame_id, reason.value, reason is FilterFailureReason.QUEUE_FULL)


def dropped_because(message: PointStamped, reason: FilterFailureReason, text: str, number: int) -> None:
    """One that also takes a text, and an argument of its own."""
    print(message.header.frame_id, reason.value, text, number)


async def filters(node: Node, buffer: Buffer) -> None:
    """A filter knows the type of its messages."""
    topic = MessageFilter((PointStamped, "points", 10), buffer, ["map"], 10, node=node, tolerance=Duration())
    assert_type(topic, MessageFilter[PointStamped])
    assert_type(topic.registerCallback(lambda message: print(message.point.x)), int)
    topic.registerCallback(with_number, 3)
    topic.registerFailureCallback(dropped)
    topic.registerFailureCallback(dropped_because, 3, with_text=True)
    assert_type(topic.statistics()["dropped"]["TIMEOUT"], int)
    async for message, transform in topic:
        assert_type(message, PointStamped)
        assert_type(transform, TransformStamped)
    assert_type(MessageFilter(topic, buffer, "map", 10, node=node), MessageFilter[PointStamped])
    policy = LookupPolicy(tolerance={"odom": 1.0}, max_age=0.5)
    MessageFilter[Imu](None, buffer, "map", 10, node=node, policy=policy).add(Imu())
    with MessageFilter((Imu, "imu", 10), buffer, "map", 10, node=node) as entered:
        assert_type(entered, MessageFilter[Imu])


def types(pose: PoseStamped) -> None:
    """The tables of functions by type, and conversions."""

    def turn(message: PoseStamped, transform: TransformStamped) -> PoseStamped:
        return PoseStamped(header=transform.header, pose=message.pose)

    def point_of(message: PoseStamped) -> PointStamped:
        return PointStamped(header=message.header, point=message.pose.position)

    registration, conversions = TransformRegistration(), ConvertRegistration()
    registration.add(PoseStamped, turn)
    assert_type(registration.get(PoseStamped)(pose, TransformStamped()), PoseStamped)
    conversions.add_convert((PoseStamped, PointStamped), point_of)
    assert_type(conversions.get_convert((PoseStamped, PointStamped))(pose), PointStamped)
    assert_type(convert(pose, PointStamped), PointStamped)
    assert_type(Stamped(pose, pose.header.stamp, "map"), PoseStamped)


def geometry(transform: TransformStamped) -> None:
    """Each function returns the type that it was given; messages and arrays."""
    assert_type(do_transform_point(PointStamped(), transform), PointStamped)
    assert_type(do_transform_point(Point(), transform), Point)
    assert_type(do_transform_imu(Imu(), transform), Imu)
    assert_type(do_transform_odometry(Odometry(), transform), Odometry)
    swept = deskew(PointCloud2(), Buffer(), "a", "b", Time(), timeout=0.1, on_missing="nan", max_gap=1)
    assert_type(swept, PointCloud2)
    read = read_points(PointCloud2(), field_names=["x", "y", "z"], skip_nans=True)
    assert_type(create_cloud(Header(), [PointField(name="x", count=1)], read), PointCloud2)
    matrix = to_matrix(to_arrays([transform, transform]))
    assert_type(matrix, Floats)
    assert_type(from_matrix(matrix), Transform)
    assert_type(from_matrix(matrix, PoseStamped), PoseStamped)
    assert_type(from_matrix(matrix, header=transform.header, child_frame_id="b"), TransformStamped)
    assert_type(to_matrix(transform, dtype=np.float32), npt.NDArray[np.float32])
    assert_type(to_columns([transform]), dict[str, npt.NDArray[Any]])


def names_of_others(node: Node) -> None:
    """What programs take from tf2's packages, although these only import it."""
    assert_type(tf2_ros.Time(), Time)
    assert_type(tf2_ros.TransformStamped(), TransformStamped)
    assert_type(tf2_ros.tf2.BufferCore(), BufferCore)
    assert_type(tf2_ros.buffer_client.BufferClient(node, "server"), BufferClient)
    assert_type(tf2_geometry_msgs.WrenchStamped(), WrenchStamped)
    numbers: tf2_ros.Tuple[int, int] = (1, 2)
    print(numbers)
