# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Makes recordings in every format, with the writers of rosbags and of mcap; needs no ROS."""

import math
import re
import shutil
from functools import cache
from typing import NamedTuple

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from mcap_protobuf.schema import register_schema
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from times_and_transforms import S, about_z
from zstandard import ZstdCompressor

TF = "tf2_msgs/msg/TFMessage"
TF_OF_OLD = "tf/msg/tfMessage"
STRING = "std_msgs/msg/String"
SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
STAMPED = "geometry_msgs/msg/PoseStamped"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
PATH = "nav_msgs/msg/Path"
WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
POSE_ARRAY = "geometry_msgs/msg/PoseArray"


class Tf(NamedTuple):
    """A transform: stamp in ns, meters, quaternion x y z w."""

    parent: str
    child: str
    ns: int
    xyz: tuple = (0.0, 0.0, 0.0)
    xyzw: tuple = (0.0, 0.0, 0.0, 1.0)


class Sent(NamedTuple):
    """A recorded message: a list of Tf, or the fields of a message of another type, or bytes as they are."""

    log_ns: int
    topic: str
    content: object
    msgtype: str = TF


def drive(count=20, *, begin_ns=100 * S, prefix="", step_ns=S // 10, speed=1.0):
    """Messages of a robot that drives in a circle: map -> odom -> base -> (static) camera, and a lidar."""
    static = [Tf("base", "camera", begin_ns, (0.3, 0.0, 0.5), about_z(0.1))]
    messages = [Sent(begin_ns, f"{prefix}/tf_static", static)]
    for i in range(count):
        ns = begin_ns + i * step_ns
        pose = (speed * math.cos(i / 10), speed * math.sin(i / 10), 0.0)
        moving = [
            Tf("map", "odom", ns, (0.01 * i, 0.0, 0.0), about_z(0.001 * i)),
            Tf("odom", "base", ns, pose, about_z(i / 10)),
        ]
        messages.append(Sent(ns + 1_000_000, f"{prefix}/tf", moving))
    lidar = [Tf("base", "lidar", begin_ns, (0.0, 0.1, 0.7))]
    messages.append(Sent(begin_ns + count * step_ns, f"{prefix}/tf_static", lidar))
    return messages


@cache
def store(ros=2):
    if ros == 2:
        return get_typestore(Stores.ROS2_JAZZY)
    store = get_typestore(Stores.ROS1_NOETIC)
    definition = "geometry_msgs/TransformStamped[] transforms"
    for name in (TF, TF_OF_OLD):
        if name not in store.fielddefs:
            store.register(get_types_from_msg(definition, name))
    return store


def header(ns, frame, ros=2):
    types = store(ros).types
    seq = {} if ros == 2 else {"seq": 7}
    stamp = types["builtin_interfaces/msg/Time"](*divmod(ns, S))
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **seq)


def message(sent, ros=2):
    """The message object of rosbags' types."""
    types = store(ros).types
    if sent.msgtype not in (TF, TF_OF_OLD):
        return types[sent.msgtype](**sent.content)
    transforms = [
        types["geometry_msgs/msg/TransformStamped"](
            header=header(tf.ns, tf.parent, ros),
            child_frame_id=tf.child,
            transform=types["geometry_msgs/msg/Transform"](
                translation=types["geometry_msgs/msg/Vector3"](*map(float, tf.xyz)),
                rotation=types["geometry_msgs/msg/Quaternion"](*map(float, tf.xyzw)),
            ),
        )
        for tf in sent.content
    ]
    return types[sent.msgtype](transforms)


def scan(log_ns, stamp_ns, topic="/scan", ros=2):
    """A message of another type, with a header."""
    names = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time")
    numbers = dict.fromkeys((*names, "range_min", "range_max"), 0.0)
    empty = np.zeros(0, np.float32)
    head = header(stamp_ns, "lidar", ros)
    return Sent(log_ns, topic, {"header": head, **numbers, "ranges": empty, "intensities": empty}, SCAN)


def posed(ns, x, topic, msgtype, frame="map", child="base", ros=2):
    """A message with the pose x, 2, 3 and a turn by x."""
    types = store(ros).types

    def make(name, *fields, **named):
        return types[f"{name.replace('/', '/msg/')}"](*fields, **named)

    point, rotation = make("geometry_msgs/Point", x, 2.0, 3.0), make("geometry_msgs/Quaternion", *about_z(x))
    if msgtype == TRANSFORM:
        moved = make("geometry_msgs/Transform", make("geometry_msgs/Vector3", x, 2.0, 3.0), rotation)
        fields = {"header": header(ns, frame, ros), "child_frame_id": child, "transform": moved}
        return Sent(ns, topic, fields, msgtype)
    pose, covariance = make("geometry_msgs/Pose", point, rotation), np.zeros(36)
    if msgtype != STAMPED:
        pose = make("geometry_msgs/PoseWithCovariance", pose, covariance)
    fields = {"header": header(ns, frame, ros), "pose": pose}
    if msgtype == ODOMETRY:
        still = [make("geometry_msgs/Vector3", 0.0, 0.0, 0.0) for _ in range(2)]
        twist = make("geometry_msgs/TwistWithCovariance", make("geometry_msgs/Twist", *still), covariance)
        fields |= {"child_frame_id": child, "twist": twist}
    return Sent(ns, topic, fields, msgtype)


def slam_path(log_ns, poses, topic="/slam/path", frame="map", ros=2):
    """A nav_msgs/Path of posed STAMPED messages."""
    stamped = [message(one, ros) for one in poses]
    return Sent(log_ns, topic, {"header": header(log_ns, frame, ros), "poses": stamped}, PATH)


def pose_array(log_ns, poses, topic="/poses", frame="map"):
    """A geometry_msgs/PoseArray of posed STAMPED messages, without their stamps."""
    return Sent(
        log_ns,
        topic,
        {"header": header(log_ns, frame), "poses": [one.content["pose"] for one in poses]},
        POSE_ARRAY,
    )


STAMPS = [100 * S + i * S // 10 for i in range(20)]


def series(topic, msgtype, **how):
    return [posed(ns, i / 10, topic, msgtype, **how) for i, ns in enumerate(STAMPS)]


def raw(sent):
    """In CDR."""
    if isinstance(sent.content, bytes):
        return sent.content
    return bytes(store().serialize_cdr(message(sent), sent.msgtype))


ANY = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.VOLATILE,
    *(QosTime(0, 0), QosTime(0, 0)),
    QosLiveliness.AUTOMATIC,
    QosTime(0, 0),
    avoid_ros_namespace_conventions=False,
)
LATCHED = ANY._replace(durability=QosDurability.TRANSIENT_LOCAL)


def write_folder(path, messages, storage="mcap", compression=None, qos=None):
    """
    A folder of rosbag2.

    :param compression: None, "file", "message", or "storage" (chunks; of mcap).
    :param qos: None, or lists of Qos, by topic.
    """
    plugin = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}[storage]
    writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    if compression is not None:
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for one in messages:
            if one.topic not in connections:
                connections[one.topic] = writer.add_connection(
                    one.topic,
                    one.msgtype,
                    typestore=store(),
                    offered_qos_profiles=(qos or {}).get(one.topic, ()),
                )
            writer.write(connections[one.topic], one.log_ns, raw(one))
    return path


def write_split(path, messages, storage="mcap", compression=None):
    """A folder of rosbag2 whose messages are split into three files, in the order given."""
    write_folder(path, messages, storage, compression)
    (whole,) = (one for one in path.iterdir() if one.suffix != ".yaml")
    size = -(-len(messages) // 3)
    names = []
    for part in range(3):
        some = messages[part * size : (part + 1) * size]
        folder = write_folder(path.parent / f"{path.name}_{part}", some, storage, compression)
        [file] = (one for one in folder.iterdir() if one.suffix != ".yaml")
        names.append(shutil.move(file, path / file.name).name)
        shutil.rmtree(folder)
    whole.unlink()
    info = (path / "metadata.yaml").read_text()
    listed = f"relative_file_paths: {names}"
    (path / "metadata.yaml").write_text(re.sub(r"relative_file_paths:\n *- .*", listed, info))
    return path


def write_mcap(
    path,
    messages,
    compression="none",
    index=IndexType.ALL,
    chunked=True,
    chunk_size=2000,
    topics=(),
    qos=None,
):
    """
    A bare .mcap, by the library mcap; small chunks, so that there are several.

    :param index: False: nothing is repeated at the end.
    """
    writer = McapWriter(
        str(path),
        chunk_size=chunk_size,
        compression=CompressionType[compression.upper()],
        index_types=index or IndexType.NONE,
        repeat_channels=bool(index),
        repeat_schemas=bool(index),
        use_statistics=bool(index),
        use_summary_offsets=bool(index),
        use_chunking=chunked,
    )
    writer.start("ros2", "tests")
    channels = {}
    for topic, msgtype in [*((one.topic, one.msgtype) for one in messages), *topics]:
        if topic not in channels:
            text, _ = store().generate_msgdef(msgtype, ros_version=2)
            schema = writer.register_schema(msgtype, "ros2msg", text.encode())
            offered = {"offered_qos_profiles": qos[topic]} if topic in (qos or {}) else {}
            channels[topic] = writer.register_channel(topic, "cdr", schema, offered)
    for one in messages:
        writer.add_message(channels[one.topic], one.log_ns, raw(one), one.log_ns)
    writer.finish()
    return path


FOXGLOVE = {TF: FrameTransforms, "FrameTransform": FrameTransform, SCAN: LaserScan}


def write_foxglove(path, messages, encoding="protobuf", index=IndexType.ALL, profile=""):
    """An .mcap as Foxglove's tools write it, of transforms and scans."""
    writer = McapWriter(str(path), chunk_size=2000, compression=CompressionType.LZ4, index_types=index)
    writer.start(profile, "tests")
    channels = {}
    for one in messages:
        if one.topic not in channels:
            schema = register_schema(writer, FOXGLOVE[one.msgtype])
            channels[one.topic] = writer.register_channel(one.topic, encoding, schema)
        writer.add_message(channels[one.topic], one.log_ns, in_protobuf(one), one.log_ns)
    writer.finish()
    return path


def in_protobuf(sent):
    if isinstance(sent.content, bytes):
        return sent.content
    if sent.msgtype == SCAN:
        stamp = sent.content["header"].stamp
        return LaserScan(timestamp={"seconds": stamp.sec, "nanos": stamp.nanosec}).SerializeToString()
    made = FrameTransforms()
    for tf in sent.content:
        seconds, nanos = divmod(tf.ns, S)
        made.transforms.add(
            timestamp={"seconds": seconds, "nanos": nanos},
            parent_frame_id=tf.parent,
            child_frame_id=tf.child,
            translation=dict(zip("xyz", tf.xyz, strict=True)),
            rotation=dict(zip("xyzw", tf.xyzw, strict=True)),
        )
    return made.SerializeToString()


def write_db3(path, messages, qos=None):
    """A bare .db3."""
    folder = write_folder(path.parent / f"{path.name}_folder", messages, "sqlite3", qos=qos)
    shutil.move(folder / f"{folder.name}.db3", path)
    shutil.rmtree(folder)
    return path


def packed(path):
    """A file compressed as rosbag2 does it; the file itself is removed."""
    whole = path.with_name(f"{path.name}.zstd")
    whole.write_bytes(ZstdCompressor().compress(path.read_bytes()))
    path.unlink()
    return whole


def write_ros1(path, messages, compression=None, msgtype=TF):
    """A .bag of ROS 1; `msgtype`: of the transforms."""
    writer = rosbag1.Writer(path)
    writer.chunk_threshold = 2000
    if compression is not None:
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression.upper()])
    with writer:
        connections = {}
        for one in messages:
            one = one._replace(msgtype=msgtype) if one.msgtype == TF else one
            if one.topic not in connections:
                connections[one.topic] = writer.add_connection(one.topic, one.msgtype, typestore=store(1))
            data = store(1).serialize_ros1(message(one, ros=1), one.msgtype)
            writer.write(connections[one.topic], one.log_ns, data)
    return path


def write_ros1_mcap(path, messages, profile="ros1"):
    """An .mcap with messages of ROS 1, whose types have names of ROS 1."""
    writer = McapWriter(str(path), chunk_size=2000, compression=CompressionType.LZ4)
    writer.start(profile, "tests")
    channels = {}
    for one in messages:
        if one.topic not in channels:
            text, _ = store(1).generate_msgdef(one.msgtype)
            schema = writer.register_schema(one.msgtype.replace("/msg/", "/"), "ros1msg", text.encode())
            channels[one.topic] = writer.register_channel(one.topic, "ros1", schema)
        data = one.content
        if not isinstance(data, bytes):
            data = bytes(store(1).serialize_ros1(message(one, ros=1), one.msgtype))
        writer.add_message(channels[one.topic], one.log_ns, data, one.log_ns)
    writer.finish()
    return path


# What writes the same messages in each format; called with a folder and the messages, returns the path.
FORMATS = {
    "folder-mcap": lambda at, m: write_folder(at / "run", m),
    "folder-mcap-file": lambda at, m: write_folder(at / "run", m, "mcap", "file"),
    "folder-mcap-message": lambda at, m: write_folder(at / "run", m, "mcap", "message"),
    "folder-mcap-storage": lambda at, m: write_folder(at / "run", m, "mcap", "storage"),
    "folder-sqlite3": lambda at, m: write_folder(at / "run", m, "sqlite3"),
    "folder-sqlite3-file": lambda at, m: write_folder(at / "run", m, "sqlite3", "file"),
    "folder-sqlite3-message": lambda at, m: write_folder(at / "run", m, "sqlite3", "message"),
    "folder-mcap-chunk-index": lambda at, m: (
        write_mcap(write_folder(at / "run", m) / "run.mcap", m, index=IndexType.CHUNK).parent
    ),
    "split-mcap": lambda at, m: write_split(at / "run", m),
    "split-mcap-file": lambda at, m: write_split(at / "run", m, "mcap", "file"),
    "split-sqlite3": lambda at, m: write_split(at / "run", m, "sqlite3"),
    "mcap": lambda at, m: write_mcap(at / "run.mcap", m),
    "mcap-lz4": lambda at, m: write_mcap(at / "run.mcap", m, "lz4"),
    "mcap-zstd": lambda at, m: write_mcap(at / "run.mcap", m, "zstd"),
    "mcap-chunk-index": lambda at, m: write_mcap(at / "run.mcap", m, "zstd", index=IndexType.CHUNK),
    "mcap-no-index": lambda at, m: write_mcap(at / "run.mcap", m, "zstd", index=False),
    "mcap-no-chunks": lambda at, m: write_mcap(at / "run.mcap", m, chunked=False),
    "mcap-plain": lambda at, m: write_mcap(at / "run.mcap", m, index=False, chunked=False),
    "foxglove": lambda at, m: write_foxglove(at / "run.mcap", m),
    "foxglove-chunk-index": lambda at, m: write_foxglove(at / "run.mcap", m, index=IndexType.CHUNK),
    "mcap-file": lambda at, m: packed(write_mcap(at / "run.mcap", m)),
    "db3": lambda at, m: write_db3(at / "run.db3", m),
    "db3-file": lambda at, m: packed(write_db3(at / "run.db3", m)),
    "ros1": lambda at, m: write_ros1(at / "run.bag", m),
    "ros1-bz2": lambda at, m: write_ros1(at / "run.bag", m, "bz2"),
    "ros1-lz4": lambda at, m: write_ros1(at / "run.bag", m, "lz4"),
    "ros1-mcap": lambda at, m: write_ros1_mcap(at / "run.mcap", m),
    "ros1-tf": lambda at, m: write_ros1(at / "run.bag", m, msgtype=TF_OF_OLD),
}
