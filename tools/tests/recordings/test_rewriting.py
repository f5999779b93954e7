# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings that are written anew: what is copied, and what is changed, read by the library mcap alone."""

import errno
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from making_bags import (
    LATCHED,
    ODOMETRY,
    SCAN,
    STAMPED,
    STRING,
    TF,
    TF_OF_OLD,
    S,
    Sent,
    Tf,
    drive,
    packed,
    posed,
    raw,
    scan,
    store,
    write_db3,
    write_folder,
    write_foxglove,
    write_mcap,
    write_ros1,
    write_ros1_mcap,
    write_split,
)
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from robot_of_all_joints import ARM, joint_state
from waiting import until

from tf2_ros import Buffer, TransformStamped
from tf2_ros.numpy import to_matrix
from tf2_ros.serialization import MessageSource, insert_messages, read_transforms
from tf2_ros_tools.bag import BagError, load
from tf2_ros_tools.bag import rewrite as rewrite_recording
from tf2_ros_tools.common.program import RunError, UsageError
from tf2_ros_tools.programs.tf2_bag import PARSER, bag

CALIBRATION = """\
- {frame_id: base, child_frame_id: camera, x: 1.5}
- {frame_id: camera, child_frame_id: lens, z: 0.25}
"""


@pytest.fixture
def rewrite(tmp_path, capsys):
    """Write a recording anew: the file, and the text of the warnings."""

    def rewrite(path, *arguments):
        written = tmp_path / "written.mcap"
        status = bag(PARSER.read(["tf2_bag", "rewrite", str(path), *map(str, arguments), "-o", str(written)]))
        out, err = capsys.readouterr()
        assert (status, out) == (0, f"{written}\n")
        return written, err

    return rewrite


def messages_of(path):
    """What an .mcap contains, in the order of the file."""
    with open(path, "rb") as file:
        found = make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)
        return [
            (one.topic, message.log_time, message.publish_time, message.sequence, message.data)
            for _, one, message in found
        ]


def others(messages):
    return [one for one in messages if not one[0].rpartition("/")[2].startswith("tf")]


def transforms_of(path):
    """The names and log times of all transforms in an .mcap."""
    return [
        (topic, log_ns, one.header.frame_id, one.child_frame_id)
        for topic, log_ns, *_, data in messages_of(path)
        if topic.rpartition("/")[2] in ("tf", "tf_static")
        for one in read_transforms(data, MessageSource(topic))
    ]


def run_of(*more, count=30):
    return sorted([*drive(count), *more], key=lambda one: one.log_ns)


SCANS = [scan(100 * S + i * S // 4, 100 * S + i * S // 4) for i in range(12)]
TEXTS = [Sent(100 * S + i * S, "/text", {"data": "ä" * i}, STRING) for i in range(3)]


def in_mcap(path, sent):
    return write_mcap(path.with_suffix(".mcap"), sent)


FORMATS = {
    "mcap": in_mcap,
    "zstd": lambda path, sent: write_mcap(path.with_suffix(".mcap"), sent, compression="zstd"),
    "unchunked": lambda path, sent: write_mcap(path.with_suffix(".mcap"), sent, chunked=False),
    "db3": lambda path, sent: write_db3(path.with_suffix(".db3"), sent),
    "folder": write_folder,
    "split": write_split,
    "messages": lambda path, sent: write_folder(path, sent, compression="message"),
    "split db3": lambda path, sent: write_split(path, sent, "sqlite3", "file"),
}


@pytest.mark.parametrize("form", FORMATS)
def test_all_that_is_not_changed_is_copied(rewrite, tmp_path, form):
    sent = run_of(*SCANS, *TEXTS)
    written, err = rewrite(FORMATS[form](tmp_path / "run", sent), "--drop", "lidar")
    assert err == ""
    wanted = [
        (one.topic, one.log_ns, raw(one))
        for one in sent
        if one.msgtype != TF or one.content[0].child != "lidar"
    ]
    found = [(topic, log_ns, data) for topic, log_ns, _, _, data in messages_of(written)]
    assert sorted(found) == sorted(wanted)
    assert found == wanted or form not in ("mcap", "unchunked", "zstd")


def test_what_mcap_has_beside_the_data_is_copied(rewrite, tmp_path):
    path = tmp_path / "run.mcap"
    with open(path, "wb") as file:
        writer = Writer(file, 500, CompressionType.LZ4)
        writer.start("ros2")
        schema = writer.register_schema(TF, "ros2msg", store().generate_msgdef(TF, ros_version=2)[0].encode())
        other = writer.register_schema("own/msg/Type", "ros2msg", b"int32 x")
        tf = writer.register_channel("/tf", "cdr", schema, {"offered_qos_profiles": "[]  # own"})
        own = [writer.register_channel("/own", "cdr", other, {"publisher": name}) for name in "ab"]
        unread = writer.register_channel("/json", "json", 0)
        for i, one in enumerate(drive(20)[1:-1]):
            writer.add_message(tf, one.log_ns, raw(one), one.log_ns - 5, i)
            writer.add_message(own[i % 2], one.log_ns - 7 * i, b"\0\1\0\0" + bytes(4), 9, 3 * i)
        writer.add_message(unread, 1, b"{}", 2, 3)
        writer.add_attachment(1, 2, "calib.yaml", "text/yaml", b"\0\1")
        writer.add_metadata("own", {"a": "b"})
        writer.add_metadata("rosbag2", {"serialized_metadata": 'version: 8\ncompression_mode: ""\n'})
        writer.finish()
    written, err = rewrite(path, "--prefix", "r1/")
    assert "frames keep their names on /json: expected the encoding cdr, got json" in err
    assert others(messages_of(written)) == others(messages_of(path))
    old, new = (_about(one) for one in (path, written))
    assert old == new
    ours, theirs = ([one[:4] for one in messages_of(one) if one[0] == "/tf"] for one in (written, path))
    assert ours == theirs


def test_frames_are_renamed_if_a_file_does_not_count_the_messages_of_topics(rewrite, tmp_path):
    path = tmp_path / "run.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema(SCAN, "ros2msg", store().generate_msgdef(SCAN)[0].encode())
        channel = writer.register_channel("/scan", "cdr", schema)
        for one in SCANS:
            writer.add_message(channel, one.log_ns, raw(one), one.log_ns)
        writer._Writer__statistics.channel_message_counts = {}  # an option of other writers
        writer.finish()
    written, _ = rewrite(path, "--prefix", "r1/")
    scans = [store().deserialize_cdr(data, SCAN) for *_, data in messages_of(written)]
    assert {one.header.frame_id for one in scans} == {"r1/lidar"}


def test_the_first_chunk_may_be_too_small_to_be_compressed(rewrite, tmp_path):
    path = tmp_path / "run.mcap"
    with open(path, "wb") as file:
        writer = Writer(file, 2000, CompressionType.NONE)
        writer.start("ros2")
        schema = writer.register_schema(TF, "ros2msg", b"")
        channel = writer.register_channel("/tf", "cdr", schema)
        for i, one in enumerate(drive(60)[1:-1]):
            writer.add_message(channel, one.log_ns, raw(one), one.log_ns)
            if i == 20:
                writer._Writer__compression = CompressionType.ZSTD
        writer.finish()
    assert _about(path)[1] == {"", "zstd"}
    assert _about(rewrite(path, "--prefix", "r1/")[0])[1] == {"zstd"}


def _about(path):
    with open(path, "rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        channels = [
            (one.topic, one.message_encoding, one.metadata, summary.schemas.get(one.schema_id))
            for one in summary.channels.values()
        ]
        compressions = {one.compression for one in summary.chunk_indexes}
        return channels, compressions, [*reader.iter_metadata()], [*reader.iter_attachments()]


def test_static_transforms_replace_those_recorded(rewrite, tmp_path):
    (tmp_path / "own.yaml").write_text(CALIBRATION)
    sent = run_of(*SCANS, Sent(101 * S, "/tf", [Tf("odom", "camera", 101 * S)]))
    path = in_mcap(tmp_path / "run", sent)
    written, _ = rewrite(path, "--statics", tmp_path / "own.yaml")
    buffer = load(written)
    assert buffer.lookup_transform("base", "camera", 0).transform.translation.x == 1.5
    assert buffer.lookup_transform("base", "lens", 0).transform.translation.z == 0.25
    assert buffer.lookup_transform("base", "lidar", 0).transform.translation.z == 0.7
    assert messages_of(written)[0][:2] == ("/tf_static", 100 * S)
    assert others(messages_of(written)) == others(messages_of(path))
    # A player's late subscriber gets only the last message.
    last = [one for one in messages_of(written) if one[0] == "/tf_static"][-1]
    assert {one.child_frame_id for one in read_transforms(last[-1], MessageSource("/tf_static"))} == {
        "camera", "lens", "lidar",
    }  # fmt: skip


@pytest.mark.parametrize("style", ["1", "keep_last", None])
def test_a_new_topic_is_latched_in_the_style_of_the_recording(rewrite, tmp_path, style):
    (tmp_path / "own.yaml").write_text(CALIBRATION)
    path = tmp_path / "run.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema(TF, "ros2msg", b"")
        qos = {} if style is None else {"offered_qos_profiles": f"- history: {style}\n  depth: 1"}
        tf = writer.register_channel("/tf", "cdr", schema, qos)
        for one in drive(5)[1:-1]:
            writer.add_message(tf, one.log_ns, raw(one), one.log_ns)
        writer.finish()
    channels, *_ = _about(rewrite(path, "--statics", tmp_path / "own.yaml")[0])
    [latched] = [metadata for topic, _, metadata, _ in channels if topic == "/tf_static"]
    wanted = ("history: 1", "durability: 1") if style == "1" else ("keep_last", "transient_local")
    assert all(one in latched["offered_qos_profiles"] for one in wanted)


@pytest.mark.parametrize("prefix", ["a/", "ro1/", "robots1/", "ro/bots/number/12/"])
def test_frames_are_renamed_in_all_topics(rewrite, tmp_path, prefix):
    """Of other lengths, so that what follows in a message moves, and of one at which it does not."""
    odometry = [posed(101 * S, 1.0, "/odom", ODOMETRY, frame="odom")]
    odometry += [posed(101 * S, 1.0, "/pose", STAMPED, frame="odom")]
    sent = run_of(*SCANS, *TEXTS, *odometry)
    path = in_mcap(tmp_path / "run", sent)
    written, err = rewrite(path, "--prefix", prefix, "--rename", "map=map", "--rename", "lidar=r2/laser")
    assert err == ""
    names = {"map": "map", "lidar": "r2/laser"}
    assert {one[2:] for one in transforms_of(written)} == {
        tuple(names.get(name, prefix + name) for name in one[2:]) for one in transforms_of(path)
    }
    for old, new in zip(messages_of(path), messages_of(written), strict=True):
        assert old[:4] == new[:4]
        for msgtype, topic in ((SCAN, "/scan"), (ODOMETRY, "/odom"), (STAMPED, "/pose")):
            if topic == old[0]:
                before = store().deserialize_cdr(old[4], msgtype)
                before.header.frame_id = names.get(before.header.frame_id, prefix + before.header.frame_id)
                if topic == "/odom":
                    before.child_frame_id = prefix + before.child_frame_id
                assert bytes(store().serialize_cdr(before, msgtype)) == new[4]
        if old[0] == "/text":
            assert old == new


MARKERS = "visualization_msgs/msg/MarkerArray"


@pytest.mark.parametrize("little", [True, False])
def test_frames_are_renamed_in_lists_and_in_both_byte_orders(rewrite, tmp_path, little):
    types = store().types
    zero = types["builtin_interfaces/msg/Time"](0, 0)
    header = types["std_msgs/msg/Header"](zero, "lidar")
    point, color = (
        types["geometry_msgs/msg/Point"](1.0, 2.0, 3.0),
        types["std_msgs/msg/ColorRGBA"](0.0, 0.5, 0.0, 1.0),
    )
    turn, scale = (
        types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        types["geometry_msgs/msg/Vector3"](1, 1, 1),
    )
    pose, span = types["geometry_msgs/msg/Pose"](point, turn), types["builtin_interfaces/msg/Duration"](0, 5)
    file = types["visualization_msgs/msg/MeshFile"]("", np.zeros(0, np.uint8))
    picture = types["sensor_msgs/msg/CompressedImage"](header, "", np.zeros(3, np.uint8))
    uv = [types["visualization_msgs/msg/UVCoordinate"](0.25, 0.5)]
    own = (
        "ns",
        7,
        1,
        0,
        pose,
        scale,
        color,
        span,
        True,
        [point],
        [color],
        "",
        picture,
        uv,
        "ä",
        "",
        file,
        False,
    )
    sent = types[MARKERS]([types["visualization_msgs/msg/Marker"](header, *own)] * 2)
    before = bytes(store().serialize_cdr(sent, MARKERS, little_endian=little))
    path = in_mcap(tmp_path / "run", run_of(Sent(101 * S, "/markers", before, MARKERS)))
    written, _ = rewrite(path, "--rename", "lidar=laser_of_robot_2")
    [after] = [data for topic, *_, data in messages_of(written) if topic == "/markers"]
    header.frame_id = "laser_of_robot_2"
    assert after == bytes(store().serialize_cdr(sent, MARKERS))


@pytest.mark.parametrize(
    ("field", "why"),
    [
        ("std_msgs/Header h", r"the recording has no definition of std_msgs/msg/Header"),
        ("wstring s", r"the recording has no definition of own/msg/wstring"),
        ("---\nstring frame_id\n" * 20, r"[^\n]{60,120} …"),  # the parser quotes all of it
    ],
)
def test_a_definition_that_cannot_be_used_is_reported(rewrite, tmp_path, field, why):
    path = tmp_path / "run.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        own = writer.register_schema("own/msg/Type", "ros2msg", f"string frame_id\n{field}".encode())
        writer.add_message(writer.register_channel("/own", "cdr", own), 1, b"\0\1\0\0", 1)
        writer.finish()
    _, err = rewrite(path, "--prefix", "r1/")
    assert re.search(f"frames keep their names on /own: {why}\n", err), err


def test_a_frame_on_both_topics_stays_on_both(rewrite, tmp_path):
    (tmp_path / "own.yaml").write_text(CALIBRATION)
    both = [
        Sent(101 * S + i, topic, [Tf("map", "gps", 101 * S)]) for i, topic in enumerate(("/tf_static", "/tf"))
    ]
    written, _ = rewrite(in_mcap(tmp_path / "run", run_of(*both)), "--statics", tmp_path / "own.yaml")
    assert ("/tf", 101 * S + 1, "map", "gps") in transforms_of(written)


def test_files_of_a_folder_share_channels_and_metadata(rewrite, tmp_path):
    """Also if their ids differ; and transforms that are alone in the first file."""
    sent = run_of(*SCANS, *TEXTS)
    path = write_split(tmp_path / "run", sent[:2] + sent[::-1][:-2])
    (tmp_path / "own.yaml").write_text(CALIBRATION)
    channels, _, metadata, _ = _about(rewrite(path, "--statics", tmp_path / "own.yaml")[0])
    assert sorted(topic for topic, *_ in channels) == ["/scan", "/text", "/tf", "/tf_static"]
    assert [one.name for one in metadata] == ["rosbag2"]  # each file has its own


@pytest.mark.parametrize("form", ["mcap", "db3"])
def test_a_recording_without_transforms_gets_some(rewrite, tmp_path, form):
    (tmp_path / "own.yaml").write_text("- {frame_id: base, child_frame_id: lidar, z: 0.5}")
    path = FORMATS[form](tmp_path / "run", [*SCANS, *TEXTS])
    written, err = rewrite(path, "--statics", tmp_path / "own.yaml", "--rename", "lidar=laser")
    assert err == ""
    assert load(written).lookup_transform("base", "lidar", 0).transform.translation.z == 0.5
    scans = [store().deserialize_cdr(one[-1], SCAN) for one in messages_of(written) if one[0] == "/scan"]
    assert {one.header.frame_id for one in scans} == {"laser"}


def test_static_transforms_are_added_to_a_recording_of_a_wrong_clock(rewrite, tmp_path):
    """Whose log times are after 2038, which stamps cannot be."""
    (tmp_path / "own.yaml").write_text(CALIBRATION)
    path = in_mcap(tmp_path / "run", [one._replace(log_ns=one.log_ns + 3 * 10**9 * S) for one in drive()])
    written, _ = rewrite(path, "--statics", tmp_path / "own.yaml")
    assert load(written).lookup_transform("base", "camera", 0).transform.translation.x == 1.5


def test_a_parent_that_nobody_knows_is_reported(rewrite, tmp_path):
    (tmp_path / "own.yaml").write_text(CALIBRATION)
    _, err = rewrite(
        in_mcap(tmp_path / "run", run_of()), "--statics", tmp_path / "own.yaml", "--prefix", "r1/"
    )
    text = "no recorded transform has base, the parent of a new static one"
    assert f"{text}; `statics` has the new names of frames" in err


def test_a_loop_of_recorded_and_new_static_transforms_is_reported(rewrite, tmp_path):
    (tmp_path / "own.yaml").write_text("- {frame_id: r1/camera, child_frame_id: r1/base}")
    path = in_mcap(tmp_path / "run", run_of())
    _, err = rewrite(path, "--statics", tmp_path / "own.yaml", "--prefix", "r1/")
    assert "with the new static transforms, r1/" in err and "is its own ancestor" in err


def test_a_loop_of_renamed_frames_is_reported(rewrite, tmp_path):
    _, err = rewrite(in_mcap(tmp_path / "run", run_of()), "--rename", "base=map")
    assert err == "tf2_bag rewrite: with the new names, map is its own ancestor\n"


def test_two_frames_that_get_one_name_are_reported(rewrite, tmp_path):
    path = in_mcap(tmp_path / "run", run_of(*SCANS))
    _, err = rewrite(path, "--rename", "lidar=camera")
    assert err == "tf2_bag rewrite: the transforms of camera, lidar are now all of camera\n"


def test_one_of_two_parents_is_dropped(rewrite, tmp_path):
    ns = 101 * S
    sent = run_of(Sent(ns, "/tf", [Tf("map", "base", ns)]), Sent(ns + 1, "/tf", [Tf("map", "gps", ns)]))
    written, _ = rewrite(in_mcap(tmp_path / "run", sent), "--drop", "map,base")
    assert ("map", "base") not in {one[2:] for one in transforms_of(written)}
    assert ("odom", "base") in {one[2:] for one in transforms_of(written)}
    assert ns not in {one[1] for one in transforms_of(written)}  # nor is there an empty message


@pytest.mark.parametrize("offset", [0, -90 * S])
def test_a_correction_arrives_with_the_odometry(rewrite, tmp_path, offset):
    """Also if the stamps are of a simulation, whose clock is not that of the log times."""
    sent = run_of(*SCANS, count=60)
    shifted = [
        one._replace(content=[tf._replace(ns=tf.ns + offset) for tf in one.content])
        if one.msgtype == TF
        else one
        for one in sent
    ]
    path = in_mcap(tmp_path / "run", shifted)
    begin = 100 + offset // S
    (tmp_path / "own.tum").write_text(
        f"{begin + 1} 1 5 0 0 0 0 1\n{begin + 3} 2 5 0 0 0 0 1\n{begin + 5} 3 5 0 0 0 0 1\n"
    )
    own = ("--trajectory", tmp_path / "own.tum", "map", "odom", "base")
    written, _ = rewrite(path, *own, "--prefix", "r1/")
    assert len(messages_of(written)) == len(messages_of(path))
    live, source = Buffer(), MessageSource("/tf")
    for topic, log_ns, _, _, data in messages_of(written):
        if topic != "/tf":
            continue
        insert_messages(live, [(type("Connection", (), {"topic": "/tf"}), log_ns, data)], [source])
        newest_ns = live.frames()["r1/base"].newest_ns
        assert live.lookup_transform("r1/map", "r1/base", newest_ns)  # whenever the robot was measured
    for second, x in ((1, 1.0), (3, 2.0), (5, 3.0)):
        at = live.lookup_transform("r1/map", "r1/base", (begin + second) * S).transform.translation
        np.testing.assert_allclose((at.x, at.y), (x, 5.0), rtol=0, atol=1e-9)


def test_a_recording_of_ros_1_becomes_one_of_ros_2(rewrite, tmp_path):
    scans = [scan(one.log_ns, one.log_ns, ros=1) for one in SCANS]
    written, err = rewrite(write_ros1(tmp_path / "run.bag", run_of(*scans)), "--prefix", "r1/")
    assert err == ""
    assert {"r1/base", "r1/camera", "r1/lidar", "r1/odom", "r1/map"} == {*load(written).frames()}
    assert len([one for one in messages_of(written) if one[0] == "/scan"]) == 12
    assert [one.name for one in tmp_path.iterdir() if one.is_dir()] == []


@pytest.mark.parametrize("msgtype", [TF, TF_OF_OLD])
def test_threads_convert_recordings_of_ros_1_and_keep_the_standard_output(tmp_path, capsys, msgtype):
    paths = [write_ros1(tmp_path / f"{i}.bag", drive(200), msgtype=msgtype) for i in range(8)]
    before = sys.stdout
    with ThreadPoolExecutor(4) as pool:
        for path in paths:
            pool.submit(rewrite_recording, path, path.with_suffix(".mcap"), drop=["lidar"])
    assert sys.stdout is before
    assert capsys.readouterr().out == ""
    assert {len(messages_of(path.with_suffix(".mcap"))) for path in paths} == {201}


@pytest.mark.parametrize("more", [[], drive(5)])
def test_a_compressed_recording_of_ros_1_becomes_one_of_ros_2(rewrite, tmp_path, more):
    scans = [scan(one.log_ns, one.log_ns, ros=1) for one in SCANS]
    path = packed(write_ros1(tmp_path / "run.bag", [*scans, *more]))
    written, err = rewrite(path, "--rename", "lidar=laser")
    assert err == ""
    found = [store().deserialize_cdr(one[-1], SCAN) for one in messages_of(written) if one[0] == "/scan"]
    assert {one.header.frame_id for one in found} == {"laser"}


@pytest.mark.parametrize(
    ("arguments", "kind", "text"),
    [
        ((), UsageError, "nothing to change"),
        (("--drop", "camra"), RunError, r"there is no frame camra with transforms; did you mean camera\?$"),
        (("--drop", "map"), RunError, "there is no frame map with transforms$"),
        (("--drop", "odom,camera"), RunError, "camera has no transforms in odom"),
        (("--rename", "camra=x"), RunError, "there is no frame camra; did you mean camera?"),
        (("--rename", "odom=base"), RunError, "the frames odom and base, .* would both be base"),
        (("--rename", "odom=a", "--rename", "odom=b"), UsageError, "expected one new name of each frame"),
        (("--topic", "/tf=r1/", "--prefix", "r2/"), UsageError, "expected `prefix`.*or prefixes of topics"),
        (("--topic", "/tf", "--start", "200"), RunError, "nothing was recorded from 200"),
        (("--poses", "/none", "--drop", "odom"), RunError, "has no topic /none"),
        (("--topic", "/none", "--drop", "odom"), RunError, "has no topic /none"),
    ],
)
def test_nothing_is_written_after_a_mistake(rewrite, tmp_path, arguments, kind, text):
    path = in_mcap(tmp_path / "run", run_of())
    (tmp_path / "written.mcap").write_bytes(b"old")
    with pytest.raises(kind, match=text):
        rewrite(path, *arguments)
    assert {one.name for one in tmp_path.iterdir()} == {"run.mcap", "written.mcap"}
    assert (tmp_path / "written.mcap").read_bytes() == b"old"


@pytest.mark.parametrize("form", [*FORMATS, "ros1"])
def test_a_full_disk_leaves_what_was_there(tmp_path, form):
    make = FORMATS.get(form, lambda path, sent: write_ros1(path.with_suffix(".bag"), sent))
    path, out = make(tmp_path / "run", run_of()), tmp_path / "written.mcap"
    out.write_bytes(b"old")
    there = {*tmp_path.rglob("*")}
    limit, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, most))
    try:
        with pytest.raises(OSError) as refusal:
            rewrite_recording(path, out, prefix="r1/")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, most))
    # rosbags decompresses these files into a temporary folder.
    full = tempfile.gettempdir() if form == "split db3" else str(out)
    assert (refusal.value.errno, refusal.value.filename) == (errno.EFBIG, full)
    assert {*tmp_path.rglob("*")} == there
    assert out.read_bytes() == b"old"


@pytest.mark.parametrize("more", [("--drop", "odom"), ("--topic", "/tf=a/", "--topic", "/b/tf=b/")])
def test_a_trajectory_that_contradicts_the_others_is_refused(rewrite, tmp_path, more):
    (tmp_path / "own.tum").write_text("101 1 5 0 0 0 0 1\n103 2 5 0 0 0 0 1\n")
    path = in_mcap(tmp_path / "run", run_of())
    with pytest.raises(UsageError, match="the trajectory replaces the transforms of odom|of one robot"):
        rewrite(path, "--trajectory", tmp_path / "own.tum", "map", "odom", "base", *more)


@pytest.mark.parametrize(
    ("moving", "more"),
    [("camera", ("--statics", "own.yaml", "--prefix", "r1/")), ("base", ("--drop", "mast,base"))],
)
def test_a_trajectory_for_another_odometry_than_the_one_that_is_written_is_refused(
    rewrite, tmp_path, monkeypatch, moving, more
):
    """In the file that is written, the robot would not be at the poses of the trajectory."""
    (tmp_path / "own.tum").write_text("101 1 5 0 0 0 0 1\n103 2 5 0 0 0 0 1\n")
    (tmp_path / "own.yaml").write_text("- {frame_id: r1/base, child_frame_id: r1/camera, x: 1.5}")
    monkeypatch.chdir(tmp_path)
    path = in_mcap(tmp_path / "run", run_of(Sent(102 * S, "/tf", [Tf("mast", "base", 101 * S)]), count=40))
    own = ("--trajectory", tmp_path / "own.tum", "map", "odom", moving)
    with pytest.raises(RunError, match=f"with the recorded transforms of {moving}, which statics or drop"):
        rewrite(path, *own, *more)
    first = rewrite(path, *more)[0].rename(tmp_path / "first.mcap")
    prefix = "r1/" * ("--prefix" in more)
    written, _ = rewrite(first, *own[:2], *(f"{prefix}{frame}" for frame in ("map", "odom", moving)))
    at = load(written).lookup_transform(f"{prefix}map", f"{prefix}{moving}", 103 * S).transform.translation
    np.testing.assert_allclose((at.x, at.y), (2.0, 5.0), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (("--statics", "calibration.yaml"), "statics are of one robot"),
        (("--urdf", "arm.urdf"), "a URDF is of one robot"),
    ],
)
def test_static_transforms_of_two_robots_are_refused(rewrite, tmp_path, monkeypatch, more, text):
    """They would be on the topic of the first one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "calibration.yaml").write_text(CALIBRATION)
    (tmp_path / "arm.urdf").write_text(ARM)
    path = in_mcap(tmp_path / "run", run_of())
    with pytest.raises(UsageError, match=text):
        rewrite(path, *more, "--topic", "/tf=a/", "--topic", "/b/tf=b/")


def test_damage_is_found(rewrite, tmp_path):
    path = write_mcap(tmp_path / "run.mcap", run_of(), compression="none")
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(RunError, match=r"run\.mcap is broken"):
        rewrite(path, "--drop", "lidar")
    assert not (tmp_path / "written.mcap").exists()


def test_a_lost_message_is_found(rewrite, tmp_path):
    """A byte that says that it is a message; nothing has a checksum in a file without chunks."""
    path = write_mcap(tmp_path / "run.mcap", run_of(*TEXTS), chunked=False)
    data = bytearray(path.read_bytes())
    record = data.index(raw(TEXTS[1])) - 22 - 9  # what comes before the data of a message
    data[record] = 0x80  # of no known kind
    path.write_bytes(data)
    with pytest.raises(RunError, match=r"its index counts 35 messages, but 34 can be read"):
        rewrite(path, "--rename", "odom=o")


def test_a_channel_that_the_index_does_not_repeat_is_reported(tmp_path):
    path = tmp_path / "run.mcap"
    with open(path, "wb") as file:
        writer = Writer(file, repeat_channels=False, repeat_schemas=False, use_chunking=False)
        writer.start("ros2")
        schema = writer.register_schema(SCAN, "ros2msg", b"")
        writer.add_message(writer.register_channel("/scan", "cdr", schema), 1, raw(SCANS[0]), 1)
        writer.finish()
    with pytest.raises(BagError, match=r"run\.mcap is broken, .*: a message of no topic"):
        rewrite_recording(path, tmp_path / "written.mcap", prefix="r1/")


@pytest.mark.parametrize("output", ["run.mcap", "link.mcap", "folder/deep/out.mcap", "pipe.mcap", "dir.mcap"])
def test_only_another_file_is_written(tmp_path, output):
    path = in_mcap(tmp_path / "run", run_of())
    folder = write_folder(tmp_path / "folder", run_of())
    (folder / "deep").mkdir()
    (tmp_path / "link.mcap").symlink_to(path)
    (tmp_path / "dir.mcap").mkdir()
    os.mkfifo(tmp_path / "pipe.mcap")
    content = path.read_bytes()
    with pytest.raises(ValueError, match="choose another"):
        rewrite_recording(folder if "folder" in output else path, tmp_path / output, drop=["lidar"])
    assert path.read_bytes() == content


def test_an_interrupt_leaves_nothing(tmp_path):
    """It arrives while messages are copied: what is written has begun, under another name."""
    path = write_mcap(tmp_path / "run.mcap", drive(60_000), compression="zstd", chunk_size=100_000)
    command = ("-m", "tf2_ros_tools.programs.tf2_bag", "rewrite", path, "--prefix", "r1/", "-o")
    with subprocess.Popen(
        [sys.executable, *command, tmp_path / "out.mcap"], stderr=subprocess.PIPE
    ) as process:
        until(lambda: any(one.name.endswith(".unfinished") for one in tmp_path.iterdir()))
        process.send_signal(signal.SIGINT)
        assert process.communicate()[1] == b""
        # To a shell, both are 130. CPython sends itself the signal again if it has interrupted the exec() of
        # a text, such as the code that rosbags makes of a type.
        assert process.returncode in (130, -signal.SIGINT)
    assert [one.name for one in tmp_path.iterdir()] == ["run.mcap"]


def test_an_interrupt_while_the_copy_of_a_recording_of_ros_1_is_removed_leaves_nothing(tmp_path, monkeypatch):
    path, unlink = write_ros1(tmp_path / "run.bag", drive()), os.unlink

    def interrupted(name, **how):
        if name == "copy.mcap":
            monkeypatch.setattr(os, "unlink", unlink)
            raise KeyboardInterrupt
        unlink(name, **how)

    monkeypatch.setattr(os, "unlink", interrupted)
    with pytest.raises(KeyboardInterrupt):
        rewrite_recording(path, tmp_path / "out.mcap", drop=["lidar"])
    assert [one.name for one in tmp_path.iterdir()] == ["run.bag"]


@pytest.mark.parametrize("form", ["mcap", "bag"])
def test_a_full_disk_is_reported_for_the_file_that_is_written(tmp_path, form):
    sent, output = drive(500), tmp_path / "out.mcap"
    path = write_ros1(tmp_path / "run.bag", sent) if form == "bag" else in_mcap(tmp_path / "run", sent)
    output.write_bytes(b"old")
    limit, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, most))
    try:
        with pytest.raises(OSError, match="File too large") as refused:
            rewrite_recording(path, output, prefix="r1/")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, most))
    assert refused.value.filename == str(output)
    assert {one.name for one in tmp_path.iterdir()} == {path.name, "out.mcap"}
    assert output.read_bytes() == b"old"


def test_a_link_to_itself_is_replaced(rewrite, tmp_path):
    (tmp_path / "written.mcap").symlink_to(tmp_path / "written.mcap")
    written, _ = rewrite(in_mcap(tmp_path / "run", run_of()), "--drop", "lidar")
    assert len(messages_of(written)) == 31


@pytest.mark.parametrize("make", [write_ros1_mcap, write_foxglove])
def test_transforms_of_another_encoding_are_refused(rewrite, tmp_path, make):
    with pytest.raises(RunError, match="expected the (encoding cdr, got ros1|type tf2.*, got foxglove)"):
        rewrite(make(tmp_path / "run.mcap", drive()), "--prefix", "r1/")


# Several robots.


def two_robots():
    """Robots a and b, whose frames have the same names, and topics of the world."""
    scans = [one._replace(topic=f"/{robot}/front/scan") for one in SCANS for robot in "ab"]
    world = [one._replace(topic="/world/scan") for one in SCANS]
    sent = [one for robot in "ab" for one in drive(30, prefix=f"/{robot}")]
    return sorted([*sent, *scans, *world, *TEXTS], key=lambda one: one.log_ns)


def frames_on(path):
    """The names of frames by the topics with scans and transforms."""
    found = {}
    for topic, *_, data in messages_of(path):
        if topic.endswith("scan"):
            found.setdefault(topic, set()).add(store().deserialize_cdr(data, SCAN).header.frame_id)
    for topic, _, parent, child in transforms_of(path):
        found.setdefault(topic, set()).update((parent, child))
    return found


@pytest.mark.parametrize("robots", ["a", "ab"])
def test_a_prefix_of_a_topic_is_for_its_namespace(rewrite, tmp_path, robots):
    path = in_mcap(tmp_path / "run", two_robots())
    prefixes = [part for one in robots for part in ("--topic", f"/{one}/tf={one}/")]
    written, err = rewrite(path, *prefixes, "--rename", "map=map")
    before, after = frames_on(path), frames_on(written)
    outside = {"/world/scan"} | {topic for topic in before if topic.startswith("/b/") and robots == "a"}
    for topic, frames in before.items():
        prefix = "" if topic in outside else f"{topic[1]}/"
        assert after[topic] == {one if one == "map" else f"{prefix}{one}" for one in frames}
    assert err.splitlines() == [
        "tf2_bag rewrite: renamed frames keep their names on "
        f"{', '.join(sorted(outside))}, topics of other namespaces"
    ]
    assert [one[:4] for one in messages_of(written)] == [one[:4] for one in messages_of(path)]


def test_static_transforms_go_to_the_topic_of_the_robot(rewrite, tmp_path):
    (tmp_path / "own.yaml").write_text("- {frame_id: a/base, child_frame_id: a/camera, x: 1.5}")
    path = in_mcap(tmp_path / "run", two_robots())
    written, _ = rewrite(path, "--topic", "/a/tf=a/", "--statics", tmp_path / "own.yaml")
    assert messages_of(written)[0][0] == "/a/tf_static"
    topics = {"/a/tf": "", "/a/tf_static": ""}
    assert (
        load(written, topics=topics).lookup_transform("a/base", "a/camera", 0).transform.translation.x == 1.5
    )
    assert ("/a/tf_static", "a/base", "a/lidar") in {(one[0], *one[2:]) for one in transforms_of(written)}


# Parts, and what becomes transforms.


@pytest.mark.parametrize("form", ["mcap", "db3"])
def test_a_part_keeps_what_late_subscribers_get(rewrite, tmp_path, form):
    sent = run_of(*SCANS, *TEXTS, *(one._replace(topic="/map") for one in TEXTS), count=40)
    path = tmp_path / f"run.{form}"
    qos = {"/map": "- history: keep_last\n  depth: 1\n  durability: transient_local"}
    if form == "db3":
        qos = {"/map": [LATCHED]}
    (write_db3 if form == "db3" else write_mcap)(path, sent, qos=qos)
    begin_ns, end_ns = 1015 * S // 10, 103 * S
    written, _ = rewrite(path, "--start", "101.5", "--end", "103")
    latched = ("/tf_static", "/map")
    wanted = [
        (one.topic, min(max(one.log_ns, begin_ns), end_ns), raw(one))
        for one in sent
        if one.topic in latched or begin_ns <= one.log_ns <= end_ns
    ]
    assert [(topic, log_ns, data) for topic, log_ns, _, _, data in messages_of(written)] == wanted


def test_only_transforms_are_left(rewrite, tmp_path):
    path = in_mcap(tmp_path / "run", run_of(*SCANS, *TEXTS))
    written, _ = rewrite(path, "--only-transforms")
    assert {topic for topic, *_ in _about(written)[0]} == {"/tf", "/tf_static"}
    assert messages_of(written) == [one for one in messages_of(path) if one[0].startswith("/tf")]


def test_transforms_that_are_left_out_with_the_other_topics_are_reported(rewrite, tmp_path):
    path = in_mcap(tmp_path / "run", two_robots())
    written, err = rewrite(path, "--topic", "/a/tf=a/", "--only-transforms")
    assert {topic for topic, *_ in messages_of(written)} == {"/a/tf"}
    text = "the transforms on /a/tf_static are left out; `topics` or `--topic` keeps them"
    assert err == f"tf2_bag rewrite: {text}\n"


def test_poses_become_transforms(rewrite, tmp_path):
    poses = [posed(100 * S + i * S, float(i), "/gps/pose", STAMPED) for i in range(3)]
    path = in_mcap(tmp_path / "run", run_of(*poses))
    written, _ = rewrite(path, "--poses", "/gps/pose=map,gps", "--prefix", "r1/")
    buffer = load(written)
    wanted = load(path, poses={"/gps/pose": ("map", "gps")})
    for one in poses:
        ours, theirs = (
            to_matrix(one) for one in (
                buffer.lookup_transform("r1/map", "r1/gps", one.log_ns),
                wanted.lookup_transform("map", "gps", one.log_ns),
            )
        )  # fmt: skip
        np.testing.assert_array_equal(ours, theirs)
    assert len([one for one in messages_of(written) if one[0] == "/gps/pose"]) == 3


def test_what_becomes_transforms_goes_to_the_topic_of_its_robot(rewrite, tmp_path):
    robots = [one for robot in ("/r", "/r1", "/r10") for one in drive(3, prefix=robot)]
    path = in_mcap(tmp_path / "run", [*robots, posed(100 * S, 1.0, "/r1/gps/pose", STAMPED)])
    prefixes = [part for one in ("r10", "r", "r1") for part in ("--topic", f"/{one}/tf={one}/")]
    written, _ = rewrite(path, *prefixes, "--poses", "/r1/gps/pose=map,gps")
    assert [one for one in transforms_of(written) if one[3].endswith("gps")] == [
        ("/r1/tf", 100 * S, "r1/map", "r1/gps")
    ]


def test_joints_become_transforms_unless_they_have_some(rewrite, tmp_path):
    names = ["lift", "roll", "extend"]
    states = [joint_state(100 * S + i * S, names, [0.1 * i] * 3) for i in range(3)]
    known = Sent(101 * S, "/tf", [Tf("base", "shoulder", 101 * S)])
    path, urdf = in_mcap(tmp_path / "run", [*states[:2], known, states[2]]), tmp_path / "arm.urdf"
    urdf.write_text(ARM)
    written, _ = rewrite(path, "--urdf", urdf, "--drop", "wheel")
    ours, theirs = load(written).histories(), load(path, urdf=urdf).histories()
    assert theirs.pop("wheel") is not None
    assert ours.keys() == theirs.keys()
    assert len(ours["shoulder"].stamps_ns) == 1
    for name, one in theirs.items():
        assert ours[name].static == one.static
        np.testing.assert_array_equal(ours[name].translations, one.translations)
    assert [one for one in messages_of(written) if one[0] == "/joint_states"] == [
        one for one in messages_of(path) if one[0] == "/joint_states"
    ]


# From Python.


def test_python_has_the_options_of_the_command(tmp_path, rewrite):
    (tmp_path / "own.yaml").write_text(CALIBRATION)
    path, written = in_mcap(tmp_path / "run", run_of(*SCANS, *TEXTS)), tmp_path / "python.mcap"
    how = {"drop": ["lidar", ("map", "odom")], "rename": {"base": "/body"}, "start": 101 * S}
    with pytest.warns(UserWarning, match="no recorded transform has base, the parent"):
        rewrite_recording(path, written, statics=tmp_path / "own.yaml", **how, only_transforms=True)
    options = ("--statics", tmp_path / "own.yaml", "--drop", "lidar", "--drop", "map,odom", "--rename")
    by_command, _ = rewrite(path, *options, "base=body", "--start", "101", "--only-transforms")
    assert by_command.read_bytes() == written.read_bytes()


def test_static_transforms_from_python_are_copied_and_checked(tmp_path, capsys):
    path, written = in_mcap(tmp_path / "run", run_of()), tmp_path / "python.mcap"
    given = TransformStamped()
    given.header.frame_id, given.child_frame_id = "base", "/imu"
    given.transform.rotation.w, given.transform.translation.x = 2.0, np.nan
    with pytest.raises(ValueError, match="a buffer refuses some of them"):
        rewrite_recording(path, written, statics=[given])
    given.transform.translation.x = 0.0
    with pytest.raises(ValueError, match="the frame 'imu' has two transforms"):
        rewrite_recording(path, written, statics=[given, given])
    with pytest.raises(TypeError, match=r"use \['lidar'\]"):
        rewrite_recording(path, written, drop="lidar")
    rewrite_recording(path, written, statics=[given], progress=True)
    assert "run.mcap" in capsys.readouterr().err
    assert (given.header.stamp.sec, given.transform.rotation.w) == (0, 2.0)
    assert load(written).frames()["imu"].parent == "base"


@pytest.mark.parametrize(
    ("arguments", "kind", "text"),
    [
        ({"drop": [1]}, TypeError, r"drop: expected a frame or a pair \(parent, frame\), got 1"),
        ({"drop": [("odom", "base", "lidar")]}, TypeError, "drop: expected a frame or a pair"),
        ({"rename": ["base"]}, TypeError, "rename: expected a dict of names, got list"),
        ({"rename": {"base": 1}}, TypeError, "rename: expected the name of a frame, got 1"),
        ({"rename": {"base": "a", "/base": "b"}}, ValueError, "rename: expected one new name of each frame"),
        ({"rename": {"base": "/"}}, ValueError, "rename: expected the name of a frame, got ''"),
        ({"rename": {"base": "a\0b"}}, ValueError, "rename: expected the name of a frame, got 'a"),
        ({"rename": {"base": "a\ud800"}}, ValueError, "rename: expected a name in UTF-8, got 'a"),
        ({"prefix": None}, TypeError, "prefix: expected a str, got NoneType"),
        ({"prefix": "a\0b"}, ValueError, "prefix: expected the name of a frame, got 'a"),
        ({"only_transforms": "no"}, TypeError, "only_transforms: expected a bool, got str"),
        ({"statics": [1]}, TypeError, "statics: expected a TransformStamped, got int"),
    ],
)
def test_python_refuses_what_would_not_name_frames(tmp_path, arguments, kind, text):
    path, written = in_mcap(tmp_path / "run", run_of()), tmp_path / "python.mcap"
    with pytest.raises(kind, match=text):
        rewrite_recording(path, written, **arguments)
    assert not written.exists()


def test_a_slash_in_front_of_the_prefix_of_a_topic_is_removed(rewrite, tmp_path):
    written, _ = rewrite(in_mcap(tmp_path / "run", run_of()), "--topic", "/tf=/r1/")
    assert {frame.partition("/")[0] for one in transforms_of(written) for frame in one[2:]} == {"r1"}
