"""A program of a user with types, which names everything public: mypy --strict and pyright accept it."""

from collections.abc import Iterator
from pathlib import PurePath
from typing import Any

import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Time as TimeMsg
from geometry_msgs.msg import (
    AccelStamped,
    Point,
    PointStamped,
    Polygon,
    PolygonStamped,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    Transform,
    TransformStamped,
    TwistStamped,
    Vector3,
    Vector3Stamped,
    VelocityStamped,
    Wrench,
    WrenchStamped,
)
from nav_msgs.msg import Odometry, Path
from rclpy.clock import TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import Imu, MagneticField, PointCloud2, PointField
from std_msgs.msg import Header
from typing_extensions import assert_type

import tf2_geometry_msgs
import tf2_ros
import tf2_ros_tools.bag
import tf2_sensor_msgs
from tf2_msgs.msg import TFMessage
from tf2_py import add_dll_directories_from_env
from tf2_py.typing import (
    DurationLike,
    HasNanoseconds,
    HasSecNanosec,
    LookupPolicy,
    TimeLike,
    TimesLike,
)
from tf2_ros import (
    DEFAULT_STATIC_TF_TOPIC,
    DEFAULT_TF_TOPIC,
    Buffer,
    BufferClient,
    BufferCore,
    BufferInterface,
    BufferServer,
    ConnectivityException,
    ConvertRegistration,
    ExtrapolationException,
    FilterFailureReason,
    FrameInfo,
    History,
    InvalidArgumentException,
    LookupException,
    MessageFilter,
    MsgStamped,
    NotImplementedException,
    Stamped,
    StaticTransformBroadcaster,
    StaticTransformListener,
    TimeoutException,
    TransformBroadcaster,
    TransformException,
    TransformListener,
    TransformRegistration,
    TypeException,
    __version__,
    convert,
    format_transform,
)
from tf2_ros.numpy import (
    from_matrix,
    from_rotation,
    propagate,
    to_arrays,
    to_columns,
    to_matrix,
    to_nanoseconds,
    to_rotation,
)
from tf2_ros.records import (
    RECORD,
    MessageSource,
    Recording,
    insert_messages,
    read_transforms,
    refusal_text,
)
from tf2_ros_tools import rerun, urdf
from tf2_ros_tools.bag import Dataset, MappedRecordings, dataset, map_recordings
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
    assert_type(buffer.cache_time_ns, int)
    buffer.set_transform(message, "somebody")
    buffer.set_transform_static(message, "somebody")
    assert_type(buffer.set_transforms([message], "somebody", static=True), int)
    assert_type(buffer.set_transforms_cdr(data, "somebody"), int)
    assert_type(buffer.lookup_transform_core("a", "b", when), TransformStamped)
    assert_type(buffer.lookup_transform_full_core("a", when, "b", when, "c"), TransformStamped)
    assert_type(buffer.can_transform_core("a", "b", when), tuple[int, str])
    assert_type(buffer.can_transform_full_core("a", when, "b", when, "c"), tuple[int, str])
    assert_type(buffer.get_latest_common_time("a", "b").nanoseconds, int)
    assert_type(buffer.lookupVelocityCore("a", "b", when, interval), Twist)
    assert_type(buffer.lookupVelocityFullCore("a", "b", "c", (0.0, 0.0, 0.0), "d", when, interval), Twist)
    assert_type(buffer.all_frames_as_yaml() + buffer.all_frames_as_string(), str)
    statistics = buffer.statistics()
    assert_type(statistics["taken"] + statistics["refused"]["REFUSED_NAN"], int)
    assert_type(buffer.frames(), dict[str, FrameInfo])
    facts = buffer.frames()["a"]
    assert_type(facts.parent, str | None)
    assert_type((facts.static, facts.count), tuple[bool, int])
    assert_type(facts.oldest_ns or facts.newest_ns, int | None)
    history: History = buffer.histories()["a"]
    print(history.frame, history.static, history.parents, history.translations, history.rotations)
    assert_type(history.stamps_ns, npt.NDArray[np.int64])
    assert_type("a" in buffer, bool)
    assert_type(buffer.tree() + format_transform(message) + __version__, str)
    assert_type(buffer.path("a", "b"), list[str])
    assert_type(buffer.parent("a", when), str | None)
    assert_type(buffer.children("a"), list[str])
    assert_type(buffer.forget("a"), bool)
    buffer.clear()
    buffer.save("a.mcap")
    assert_type(BufferCore.load("a.mcap"), BufferCore)
    assert_type(Buffer.load(PurePath("a.mcap")), Buffer)


def series(buffer: Buffer, many: TimesLike, points: npt.NDArray[np.float32]) -> None:
    """Many lookups at once."""
    answers = buffer.lookup_transforms("a", "b", many, fixed_frame="c", target_time=Time(), on_missing="nan")
    assert_type(answers, tuple[Floats, Floats])
    buffer.lookup_transforms("a", "b", [1, 2])
    assert_type(buffer.lookup_transforms("a", ["b", "c"], [1, 2]), tuple[Floats, Floats])
    buffer.lookup_transforms("a", "b", np.array([1, 2]))
    buffer.lookup_transforms("a", "b", [TimeMsg(), TimeMsg()])
    velocities = buffer.lookup_velocities("a", "b", many, Duration(seconds=1), on_missing="nan")
    assert_type(velocities, tuple[Floats, Floats])
    assert_type(buffer.transform_points(points, many, "a", "b"), npt.NDArray[np.float32])
    assert_type(buffer.transform_points([[1.0, 2.0, 3.0]], many, "a", "b"), Floats)


async def changes(buffer: Buffer, policy: LookupPolicy) -> None:
    """What a lookup accepts, and following it."""
    assert_type(buffer.lookup_transform("a", "b", 1, **policy), TransformStamped)
    assert_type(await buffer.lookup_transform_async("a", "b", 1, tolerance=0.5), TransformStamped)
    async for transform in buffer.changes("a", "b"):
        assert_type(transform, TransformStamped)
    buffer.on_change("a", "b", print).cancel()


def lookups(buffer: Buffer | BufferClient, message: PoseStamped, timeout: DurationLike) -> None:
    """The lookups of a Buffer and of a BufferClient."""
    stamp = message.header.stamp
    assert_type(buffer.lookup_transform("a", "b", stamp), TransformStamped)
    assert_type(buffer.lookup_transform("a", "b", stamp, timeout), TransformStamped)
    assert_type(buffer.lookup_transform_full("a", Time(), "b", stamp, "c", timeout), TransformStamped)
    assert_type(buffer.can_transform("a", "b", stamp), bool)
    assert_type(buffer.can_transform("a", "b", stamp, timeout), bool)
    assert_type(buffer.can_transform("a", "b", stamp, return_debug_tuple=True), tuple[bool, str])
    assert_type(buffer.can_transform("a", "b", stamp, timeout, True), tuple[bool, str])
    assert_type(buffer.can_transform_full("a", stamp, "b", stamp, "c", timeout), bool)
    assert_type(
        buffer.can_transform_full("a", stamp, "b", stamp, "c", return_debug_tuple=True), tuple[bool, str]
    )
    assert_type(buffer.can_transform_full("a", stamp, "b", stamp, "c", timeout, True), tuple[bool, str])


def transforms(buffer: BufferInterface, message: PoseStamped, timeout: DurationLike) -> None:
    """What goes in comes out, or what `new_type` says."""
    moved = buffer.transform(message, "a")
    assert_type(moved, PoseStamped)
    assert_type(buffer.transform(message, "a", timeout), PoseStamped)
    assert_type(buffer.transform(message, "a", new_type=PointStamped), PointStamped)
    assert_type(buffer.transform(message, "a", timeout, PointStamped), PointStamped)
    assert_type(buffer.transform_full(message, "a", Time(), "b"), PoseStamped)
    assert_type(buffer.transform_full(message, "a", Time(), "b", timeout, PointStamped), PointStamped)
    assert_type(buffer.registration, TransformRegistration)


async def coroutines(buffer: Buffer, client: BufferClient, message: PoseStamped) -> None:
    """What is awaited."""
    stamp = message.header.stamp
    for owner in (buffer, client):
        assert_type(await owner.lookup_transform_async("a", "b", stamp), TransformStamped)
        assert_type(
            await owner.lookup_transform_full_async("a", stamp, "b", stamp, "c", timeout=1.0),
            TransformStamped,
        )
        assert_type(await owner.transform_async(message, "a", 1.5), PoseStamped)
        assert_type(await owner.transform_async(message, "a", new_type=PointStamped), PointStamped)
    future = buffer.wait_for_transform_async("a", "b", stamp, timeout=Duration(seconds=1))
    future.add_done_callback(lambda done: print(done.result()))
    assert_type(future.done() or future.cancelled(), bool)
    assert_type(future.exception(), BaseException | None)
    assert_type(future.result(), TransformStamped)
    assert_type(await future, TransformStamped)
    print((await buffer.wait_for_transform_full_async("a", stamp, "b", stamp, "c")).child_frame_id)


def buffers(node: Node, jump: TimeJump) -> None:
    """Making and ending them."""
    buffer = Buffer(cache_time=Duration(seconds=5), node=node, max_frames=100)
    buffer.time_jump_callback(jump)
    print(buffer.registration, buffer.clock, buffer.jump_handle, buffer.srv)
    client = BufferClient(node, "server", check_frequency=5.0, timeout_padding=Duration(seconds=1))
    print(client.node, client.action_client, client.check_frequency, client.timeout_padding)
    client.destroy()
    BufferServer(buffer, node, "server", check_period=0.1).destroy()


def listeners(node: Node, buffer: Buffer, qos: QoSProfile, message: TFMessage) -> None:
    """Everything of a listener."""
    with TransformListener(
        buffer, node, spin_thread=True, qos=qos, static_qos=10, tf_topic=DEFAULT_TF_TOPIC, static_only=False
    ) as listener:
        assert_type(listener, TransformListener)
        assert_type(listener.receives, tuple[str, ...])
        listener.callback(message)
        listener.static_callback(message)
        print(listener.buffer, listener.node, listener.group, listener.tf_sub, listener.tf_static_sub)
        print(listener.executor, listener.dedicated_listener_thread)
    listener.unregister()
    with StaticTransformListener(buffer, None, tf_static_topic=DEFAULT_STATIC_TF_TOPIC) as static_listener:
        assert_type(static_listener, StaticTransformListener)


def broadcasters(node: Node, qos: QoSProfile, transform: TransformStamped) -> None:
    """One transform, or several."""
    broadcaster = TransformBroadcaster(node, qos, strict=True)
    broadcaster.sendTransform(transform)
    broadcaster.sendTransform([transform])
    static_broadcaster = StaticTransformBroadcaster(node)
    static_broadcaster.sendTransform((transform,))
    print(broadcaster.pub_tf, static_broadcaster.pub_tf, static_broadcaster.net_message)


def with_number(message: PointStamped, number: int) -> None:
    """A callback with an argument of its own."""
    print(message.point.x, number)


def dropped(message: PointStamped, reason: FilterFailureReason) -> None:
    """A callback for failures."""
    late = (FilterFailureReason.OUT_THE_BACK, FilterFailureReason.TIMEOUT, FilterFailureReason.QUEUE_FULL)
    nowhere = (FilterFailureReason.EMPTY_FRAME_ID, FilterFailureReason.NO_TRANSFORM_FOUND)
    print(message.header.frame_id, reason.value, reason in late or reason in nowhere)


async def filters(node: Node, buffer: Buffer, qos: QoSProfile) -> None:
    """A filter knows the type of its messages."""
    topic = MessageFilter(
        (PointStamped, "points", 10),
        buffer,
        ["map"],
        10,
        node=node,
        buffer_timeout=Duration(seconds=1),
        tolerance=Duration(),
    )
    assert_type(topic, MessageFilter[PointStamped])
    assert_type(topic.registerCallback(lambda message: print(message.point.x)), int)
    topic.registerCallback(with_number, 3)
    topic.registerFailureCallback(dropped)
    topic.add(PointStamped())
    assert_type(topic.statistics()["received"] + topic.statistics()["dropped"]["TIMEOUT"], int)
    print(topic.callbacks)
    async for message, transform in topic:
        assert_type(message, PointStamped)
        assert_type(transform, TransformStamped)
    chained = MessageFilter(topic, buffer, "map", 10, node=node)
    assert_type(chained, MessageFilter[PointStamped])
    by_hand = MessageFilter[Imu](None, buffer, "map", 10, node=node)
    by_hand.add(Imu())
    with MessageFilter((Imu, "imu", 10), buffer, "map", 10, node=node) as entered:
        assert_type(entered, MessageFilter[Imu])
    for ended in (topic, chained):
        ended.clear()
        ended.close()


def types(pose: PoseStamped) -> None:
    """The tables of functions by type, and conversions."""

    def turn(message: PoseStamped, transform: TransformStamped) -> PoseStamped:
        return PoseStamped(header=transform.header, pose=message.pose)

    def point_of(message: PoseStamped) -> PointStamped:
        return PointStamped(header=message.header, point=message.pose.position)

    registration, conversions = TransformRegistration(), ConvertRegistration()
    registration.add(PoseStamped, turn)
    assert_type(registration.get(PoseStamped)(pose, TransformStamped()), PoseStamped)
    registration.print_me()
    conversions.add_to_msg(PoseStamped, point_of)
    conversions.add_from_msg(PointStamped, point_of)
    conversions.add_convert((PoseStamped, PointStamped), point_of)
    assert_type(conversions.get_convert((PoseStamped, PointStamped))(pose), PointStamped)
    print(conversions.get_to_msg(PoseStamped)(pose))
    assert_type(conversions.get_from_msg(PointStamped)(pose), PointStamped)
    assert_type(convert(pose, PointStamped), PointStamped)
    assert_type(Stamped(pose, Time(), "map"), PoseStamped)
    assert_type(Stamped(pose, pose.header.stamp, "map"), PoseStamped)
    either: MsgStamped = pose
    print(either.header.frame_id)
    print(tf2_ros.TransformableObject, tf2_ros.TransformableObjectType, tf2_ros.PyKDLType)


def geometry(transform: TransformStamped, points: Floats) -> None:
    """Each function gives what it was given."""
    assert_type(tf2_geometry_msgs.do_transform_point(PointStamped(), transform), PointStamped)
    assert_type(tf2_geometry_msgs.do_transform_point(Point(), transform), Point)
    assert_type(tf2_geometry_msgs.do_transform_vector3(Vector3Stamped(), transform), Vector3Stamped)
    assert_type(tf2_geometry_msgs.do_transform_vector3(Vector3(), transform), Vector3)
    assert_type(tf2_geometry_msgs.do_transform_pose(Pose(), transform), Pose)
    assert_type(tf2_geometry_msgs.do_transform_pose_stamped(PoseStamped(), transform), PoseStamped)
    assert_type(
        tf2_geometry_msgs.do_transform_pose_with_covariance(PoseWithCovariance(), transform),
        PoseWithCovariance,
    )
    assert_type(
        tf2_geometry_msgs.do_transform_pose_with_covariance_stamped(PoseWithCovarianceStamped(), transform),
        PoseWithCovarianceStamped,
    )
    assert_type(tf2_geometry_msgs.do_transform_pose_array(PoseArray(), transform), PoseArray)
    assert_type(tf2_geometry_msgs.do_transform_polygon(Polygon(), transform), Polygon)
    assert_type(tf2_geometry_msgs.do_transform_polygon_stamped(PolygonStamped(), transform), PolygonStamped)
    assert_type(tf2_geometry_msgs.do_transform_quaternion(Quaternion(), transform), Quaternion)
    assert_type(
        tf2_geometry_msgs.do_transform_quaternion_stamped(QuaternionStamped(), transform), QuaternionStamped
    )
    assert_type(tf2_geometry_msgs.do_transform_transform(Transform(), transform), Transform)
    assert_type(
        tf2_geometry_msgs.do_transform_transform_stamped(TransformStamped(), transform), TransformStamped
    )
    assert_type(tf2_geometry_msgs.do_transform_twist_stamped(TwistStamped(), transform), TwistStamped)
    assert_type(tf2_geometry_msgs.do_transform_accel_stamped(AccelStamped(), transform), AccelStamped)
    assert_type(
        tf2_geometry_msgs.do_transform_velocity_stamped(VelocityStamped(), transform), VelocityStamped
    )
    assert_type(tf2_geometry_msgs.do_transform_wrench(Wrench(), transform), Wrench)
    assert_type(tf2_geometry_msgs.do_transform_wrench_stamped(WrenchStamped(), transform), WrenchStamped)
    assert_type(tf2_geometry_msgs.do_transform_odometry(Odometry(), transform), Odometry)
    assert_type(tf2_geometry_msgs.do_transform_path(Path(), transform), Path)
    assert_type(tf2_geometry_msgs.transform_covariance(PoseWithCovariance().covariance, transform), Floats)
    assert_type(tf2_geometry_msgs.to_msg_msg(Pose()), Pose)
    assert_type(tf2_geometry_msgs.from_msg_msg(Pose()), Pose)
    assert_type(tf2_sensor_msgs.do_transform_cloud(PointCloud2(), transform), PointCloud2)
    assert_type(tf2_sensor_msgs.do_transform_imu(Imu(), transform), Imu)
    assert_type(tf2_sensor_msgs.do_transform_magnetic_field(MagneticField(), transform), MagneticField)
    print(tf2_sensor_msgs.transform_points(points, transform.transform).shape)
    read = read_points(PointCloud2(), field_names=["x", "y", "z"], skip_nans=True)
    assert_type(create_cloud(Header(), [PointField(name="x", count=1)], read), PointCloud2)
    assert_type(tf2_sensor_msgs.to_msg_msg(Imu()), Imu)
    assert_type(tf2_sensor_msgs.from_msg_msg(Imu()), Imu)


def recordings(path: PurePath, when: TimeLike, interval: DurationLike) -> Buffer | None:
    """Recordings read."""
    topics = {"/robot1/tf": "robot1/", "/robot1/tf_static": "robot1/"}
    found = tf2_ros_tools.bag.transforms(path, topics=["/tf"], start=when, end=1)
    assert_type(found, Iterator[tuple[int, bool, TransformStamped]])
    assert_type(tf2_ros_tools.bag.load("drive.mcap", cache_time=2.5), Buffer)
    assert_type(tf2_ros_tools.bag.stamps(path, "/points"), npt.NDArray[np.int64])
    try:
        return tf2_ros_tools.bag.load(
            path,
            cache_time=interval,
            topics=topics,
            start=when,
            end=when,
            poses={"/odom": None, "/gps/pose": ("map", "gps")},
            urdf={"/joint_states": True},
            progress=False,
        )
    except (tf2_ros_tools.bag.BagError, tf2_ros_tools.bag.BagWarning):
        return None


def joints(path: PurePath) -> None:
    """A robot's joints."""
    try:
        robot = urdf.load(path, prefix="left/")
    except urdf.UrdfError as error:
        raise SystemExit(str(error)) from None
    assert_type(robot, urdf.Robot)
    moved = robot.transforms(["elbow"], [0.1])
    assert_type(moved, tuple[list[urdf.Joint], Floats, Floats])
    assert_type(robot.static_transforms(), list[TransformStamped])
    assert_type([one.mimic for one in robot.joints], list[tuple[str, float, float] | None])
    print(robot.name, robot.root, tf2_ros_tools.bag.load("arm", urdf=robot))
    print(tf2_ros_tools.bag.load("arm", urdf=True))


def matrices(transform: TransformStamped) -> None:
    """Messages and arrays."""
    matrix = to_matrix(transform)
    assert_type(matrix, Floats)
    assert_type(from_matrix(matrix), Transform)
    assert_type(from_matrix(matrix, PoseStamped), PoseStamped)
    assert_type(from_matrix(matrix, header=transform.header, child_frame_id="b"), TransformStamped)
    assert_type(to_arrays([transform, transform]), tuple[Floats, Floats])
    assert_type(to_matrix(to_arrays([transform, transform])), Floats)
    assert_type(propagate(np.eye(6), transform, lever_arm=True), Floats)
    assert_type(to_matrix(transform, dtype=np.float32), npt.NDArray[np.float32])
    assert_type(to_columns([transform]), dict[str, npt.NDArray[Any]])
    assert_type(from_rotation(to_rotation(transform)), Quaternion)


def drawn(buffer: Buffer, many: TimesLike) -> None:
    rerun.log(buffer, frames={"camera"}, origin="map", root="robots/one", times=many, axes=0.1)
    try:
        rerun.save(buffer, PurePath("a.rrd"), rate=30.0)
        rerun.view(buffer)
    except rerun.ViewerError as failure:
        assert_type(failure, rerun.ViewerError)


def recorded(node: Node, buffer: Buffer, data: bytes) -> None:
    """Who sent which transform when, of a listener and of messages."""
    recording = Recording(1000)
    print(TransformListener(buffer, node, recording=recording))
    source = MessageSource("/tf", static=False, prefix="robot/")
    print(source.topic, RECORD)
    records: list[npt.NDArray[np.void]] = []
    count = insert_messages(
        buffer,
        [("/tf", 1, data)],
        [source],
        on_malformed=lambda topic, ns, error: print(topic, ns, error),
        on_broken=lambda error, last_ns: error,
        recording=recording,
        records=records,
        progress=print,
    )
    assert_type(count, int)
    assert_type(read_transforms(data, source), list[TransformStamped])
    assert_type(recording.take(), npt.NDArray[np.void])
    assert_type(recording.frames(), list[str])
    assert_type(recording.publishers(), list[bytes])
    assert_type(recording.messages + recording.malformed + recording.lost, int)
    assert_type(refusal_text(1), str)
    moments: list[TimeLike] = [Time(), 1]
    assert_type(to_nanoseconds(moments), npt.NDArray[np.int64])


def many_recordings(paths: list[str]) -> None:
    result = map_recordings("runs", "map", "camera", "poses", at="/scan", workers=2, progress=False)
    assert_type(result, MappedRecordings)
    map_recordings(paths, "map", "camera", "poses", rate=10.0, topics={"/robot1/tf": "robot1/"})
    map_recordings(paths, "map", "camera", "poses", scheduler="tcp://127.0.0.1:8786")
    map_recordings(paths, "map", ["camera"], "poses", at="/scan", poses={"/odom": None}, urdf=True)
    data = dataset(paths, ["camera"], at="/scan", relative_to="map", out="poses", workers=1)
    assert_type(data, Dataset)
    assert_type(data.where(data.valid.all(axis=1)).poses, Floats)
    assert_type(data[0], dict[str, Any])
    data.save("data.npz")
    print(len(data), data.files, data.failed, data.episodes, data.indices, data.stamps_ns, data.gaps)
    print(
        [*result.done.items(), *result.skipped.items(), *result.failed.values(), result.out, result.findings]
    )


def errors(buffer: Buffer) -> str:
    """Every exception."""
    try:
        with add_dll_directories_from_env("PATH"):
            buffer.lookup_transform("a", "b", Time())
    except (ConnectivityException, ExtrapolationException, InvalidArgumentException) as error:
        return str(error)
    except (LookupException, TimeoutException, TransformException) as error:
        return str(error)
    except (TypeException, NotImplementedException) as error:
        return error.errstr
    return ""
