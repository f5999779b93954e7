"""
Mistakes of a user: mypy --strict and pyright report the lines marked with `wrong`, and no others.

For mypy, a message without stubs is Any: it misses those that are marked `for pyright`.
"""

from geometry_msgs.msg import PointStamped, PoseStamped, TransformStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import Imu

from tf2_geometry_msgs import do_transform_point, do_transform_pose_stamped
from tf2_py.typing import DurationLike, TimeLike
from tf2_ros import (
    Buffer,
    BufferClient,
    BufferCore,
    BufferServer,
    ConvertRegistration,
    FilterFailureReason,
    MessageFilter,
    Stamped,
    TransformBroadcaster,
    TransformListener,
    TransformRegistration,
    convert,
)
from tf2_ros.numpy import from_matrix, to_arrays, to_matrix


class Named:
    """Neither a time nor a buffer."""

    name = "base_link"


def times(buffer: Buffer, pose: PoseStamped) -> None:
    """Times, timeouts and durations."""
    buffer.lookup_transform("a", "b", pose.header)  # wrong for pyright
    buffer.lookup_transform("a", "b", "now")  # wrong
    buffer.lookup_transform("a", "b", None)  # wrong
    buffer.lookup_transform("a", "b", 1.5)  # wrong: nanoseconds are an int
    buffer.lookup_transform("a", "b", Named())  # wrong
    buffer.lookup_transform("a", "b", Time(), "1 s")  # wrong
    buffer.lookup_transform("a", "b", Time(), None)  # wrong
    buffer.lookup_transform("a", "b")  # wrong: there is no default time
    buffer.lookup_transform("a", Time(), "b")  # wrong: the order of lookup_transform_full
    buffer.lookup_transform_full("a", "b", Time(), Time(), "c")  # wrong
    buffer.lookup_transforms("a", "b", [Time(), Named()])  # wrong
    buffer.lookup_transforms("a", "b", [1], on_missing="skip")  # wrong
    print(buffer.lookup_transforms("a", "b", [1]).translations)  # wrong: it is a tuple
    buffer.lookup_transform("a", "b", tme=Time())  # wrong
    time: TimeLike = 0.5  # wrong
    timeout: DurationLike = "0.5"  # wrong
    print(time, timeout)
    print(Buffer("10"))  # wrong: how far back is a duration, or seconds
    print(BufferCore(max_frames="many"))  # wrong
    print(Buffer(max_framse=10))  # wrong
    print(buffer.transform_points([1.0, 2.0, 3.0], [1], "a", "b"))  # wrong: one point is a row, too


def flags(buffer: Buffer, client: BufferClient) -> None:
    """What can_transform returns depends on its flag."""
    can, reason = buffer.can_transform("a", "b", Time())  # wrong
    can = buffer.can_transform("a", "b", Time(), return_debug_tuple=True).real  # wrong
    print(can, reason, client.can_transform_full("a", Time(), "b", Time(), "c")[1])  # wrong
    print(client.can_transform("a", "b", Time(), return_debug_tuple="yes"))  # wrong


def results(buffer: Buffer, pose: PoseStamped) -> None:
    """What comes out."""
    moved = buffer.transform(pose, "map")
    print(moved.pose.positoin)  # wrong for pyright
    print(moved.pose.position.w)  # wrong for pyright
    print(buffer.transform(pose, "map", new_type=PointStamped).pose)  # wrong for pyright
    print(buffer.transform_full(pose, "map", Time(), "odom").point)  # wrong for pyright
    print(buffer.lookup_transform("a", "b", Time()).translation)  # wrong for pyright
    print(buffer.wait_for_transform_async("a", "b", Time()).result().rotation)  # wrong for pyright
    print(buffer.statistics()["token"])  # wrong
    print(buffer.get_latest_common_time("a", "b").seconds)  # wrong
    print(convert(pose, PointStamped).pose)  # wrong for pyright
    print(Stamped(pose, Time(), "map").point)  # wrong for pyright
    print(Stamped(pose, 1.5, "map"))  # wrong
    print(from_matrix(to_matrix(pose)).pose)  # wrong for pyright
    print(from_matrix(to_matrix(pose), PoseStamped).pose.translation)  # wrong for pyright
    print(from_matrix(to_matrix(pose), Imu))  # wrong for pyright
    print(to_arrays([pose]).shape)  # wrong
    print(do_transform_pose_stamped(pose, pose))  # wrong for pyright
    print(do_transform_pose_stamped(PointStamped(), TransformStamped()))  # wrong for pyright
    print(do_transform_point(PointStamped(), TransformStamped()).pose)  # wrong for pyright
    buffer.transform(pose, target="map")  # wrong
    buffer.set_transform(pose, "somebody")  # wrong for pyright
    buffer.lookup_transfrom("a", "b", Time())  # wrong


async def coroutines(buffer: Buffer, pose: PoseStamped) -> None:
    """What is awaited."""
    moved = await buffer.transform_async(pose, "map")
    print(moved.point)  # wrong for pyright
    print((await buffer.lookup_transform_async("a", "b", Time())).translation)  # wrong for pyright
    print((await buffer.wait_for_transform_async("a", "b", Time())).translation)  # wrong for pyright
    print(buffer.lookup_transform_async("a", "b", Time()).transform)  # wrong: it was not awaited
    await buffer.transform_async(pose, "map", "1 s")  # wrong


def takes_imu(message: Imu) -> None:
    """A callback for another type."""
    print(message.orientation)


def takes_reason(message: PointStamped, reason: FilterFailureReason) -> None:
    """A callback for failures."""
    print(message, reason)


async def filters(buffer: Buffer, node: Node) -> None:
    """A filter of points."""
    points = MessageFilter((PointStamped, "points", 10), buffer, "map", 10, node=node)
    points.registerCallback(takes_imu)  # wrong for pyright
    points.registerCallback(takes_reason)  # wrong
    points.registerFailureCallback(takes_imu)  # wrong
    points.registerCallback(lambda message: print(message.pose))  # wrong for pyright
    points.add(PoseStamped())  # wrong for pyright
    print(points.statistics()["recieved"])  # wrong
    async for message, transform in points:
        print(message.pose)  # wrong for pyright
        print(transform.rotation)  # wrong for pyright
    MessageFilter("points", buffer, "map", 10, node=node)  # wrong
    MessageFilter(None, buffer, "map", 10, node=node, tolerance="0.5")  # wrong
    MessageFilter((PointStamped, "points"), buffer, "map", 10, node=node)  # wrong
    MessageFilter(None, BufferCore(), "map", 10, node=node)  # wrong


def nodes(buffer: Buffer, node: Node, pose: PoseStamped) -> None:
    """Listeners, broadcasters, servers."""
    TransformListener(node, buffer)  # wrong: the buffer comes first
    TransformListener(buffer, node, True)  # wrong: only by keyword
    TransformBroadcaster(node).sendTransform(pose)  # wrong for pyright
    TransformBroadcaster(node).sendTransform([pose])  # wrong for pyright
    BufferServer(node, buffer, "server")  # wrong
    BufferClient(node)  # wrong
    BufferClient(node, "server", timeout_padding=Duration).destroy()  # wrong


def turn(message: PoseStamped, transform: TransformStamped) -> PoseStamped:
    """A function for one type."""
    return do_transform_pose_stamped(message, transform)


def tables(pose: PoseStamped) -> None:
    """Functions by type."""
    TransformRegistration().add(PoseStamped, turn)
    TransformRegistration().add(Imu, turn)  # wrong for pyright
    print(TransformRegistration().get(PoseStamped)(pose, pose))  # wrong for pyright
    ConvertRegistration().add_convert((PoseStamped, PointStamped), turn)  # wrong
    print(ConvertRegistration().get_from_msg(PointStamped)(pose).pose)  # wrong for pyright
