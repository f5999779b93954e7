# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings: what is loaded from every format, from which times and topics, and from broken files."""

import os
import re
import shutil
import sqlite3
import struct
import sys
import warnings
from collections import Counter
from contextlib import closing
from dataclasses import replace
from subprocess import run

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from making_bags import (
    FORMATS,
    ODOMETRY,
    SCAN,
    STRING,
    TF,
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
from mcap.writer import Writer
from rosbags import rosbag2

from tf2_py import TransformException
from tf2_ros import Buffer
from tf2_ros_tools import bag
from tf2_ros_tools.recordings.bag_loader import read_contents, wanted
from tf2_ros_tools.recordings.bag_reader import is_static, open_recording
from tf2_ros_tools.recordings.report import report

DRIVE = drive(40)


def flat(messages):
    """The transforms as (log time, static, parent, child, stamp, numbers)."""
    return [
        (one.log_ns, is_static(one.topic), tf.parent, tf.child, tf.ns, (*tf.xyz, *tf.xyzw))
        for one in messages
        for tf in one.content
    ]


def flat_read(path, **arguments):
    found = []
    for log_ns, static, m in bag.transforms(path, **arguments):
        stamp, t, q = m.header.stamp, m.transform.translation, m.transform.rotation
        numbers = (t.x, t.y, t.z, q.x, q.y, q.z, q.w)
        ns = stamp.sec * S + stamp.nanosec
        found.append((log_ns, static, m.header.frame_id, m.child_frame_id, ns, numbers))
    return found


def flat_heard(heard):
    """The same of records, without numbers."""
    return [
        (
            int(one["received_ns"]),
            bool(one["static"]),
            *(heard.frames[one[name]] for name in ("parent", "child")),
            int(one["stamp_ns"]),
        )
        for one in heard.records
    ]


def answers(buffer, frames=("map", "odom", "base", "camera", "lidar")):
    """What a buffer says of all pairs of frames, over time."""
    times = np.arange(99 * S, 106 * S, S // 20)
    found = []
    for target in frames:
        for source in frames:
            try:
                found.append(buffer.lookup_transforms(target, source, times, on_missing="nan"))
            except TransformException as error:
                found.append(str(error))
    return found


def filled(messages):
    """A buffer filled message by message, without a recording."""
    buffer = Buffer(float("inf"))
    for one in messages:
        buffer.set_transforms_cdr(raw(one), one.topic, is_static(one.topic))
    return buffer


EXPECTED = answers(filled(DRIVE))


# Every format.


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_holds_the_same(form, tmp_path):
    ros = 1 if "ros1" in form else 2
    scans = [scan(105 * S + i, 90 * S + 3 * i, ros=ros) for i in range(5)]
    path = FORMATS[form](tmp_path, [*DRIVE, *scans])
    buffer = bag.load(str(path))
    np.testing.assert_equal(answers(buffer), EXPECTED)
    assert buffer.statistics()["taken"] == len(flat(DRIVE))
    listed = buffer.all_frames_as_yaml()
    assert "broadcaster: '/tf'\n" in listed and "broadcaster: '/tf_static'\n" in listed
    assert sorted(flat_read(path)) == sorted(flat(DRIVE))
    heard = read_contents(path)
    assert flat_heard(heard) == [one[:5] for one in flat(DRIVE)]
    assert set(heard.publishers) == {"/tf", "/tf_static"}
    assert (heard.start_ns, heard.end_ns) == (DRIVE[0].log_ns, scans[-1].log_ns)
    assert bag.stamps(path, "/scan").tolist() == [90 * S + 3 * i for i in range(5)]
    with open_recording(path) as recorded:
        counts = {name: topic.count for name, topic in recorded.topics.items()}
    assert counts == Counter(one.topic for one in [*DRIVE, *scans])


@pytest.mark.parametrize("form", ["mcap", "ros1", "foxglove"])  # one for each encoding of messages
def test_a_stamp_that_is_not_set_is_not_a_time(form, tmp_path):
    stamps, ros = [100 * S + 7, 0, 101 * S, 0], 1 if form == "ros1" else 2
    scans = [scan(100 * S + i, ns, ros=ros) for i, ns in enumerate(stamps)]
    path = FORMATS[form](tmp_path, [*drive(20), *scans])
    assert np.isnat(bag.stamps(path, "/scan").view("M8[ns]")).tolist() == [False, True, False, True]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_file_of_compressed_messages_needs_no_folder(storage, tmp_path):
    scans = [scan(105 * S + i, 90 * S + 3 * i) for i in range(5)]
    folder = write_folder(tmp_path / "run", [*DRIVE, *scans], storage, "message")
    [file] = (one for one in folder.iterdir() if one.suffix != ".yaml")
    alone = file.rename(tmp_path / file.name)
    np.testing.assert_equal(answers(bag.load(alone)), EXPECTED)
    assert sorted(flat_read(alone)) == sorted(flat(DRIVE))
    assert bag.stamps(alone, "/scan").tolist() == [90 * S + 3 * i for i in range(5)]


@pytest.mark.parametrize("profile", ["ros2", ""])
def test_types_may_have_names_of_ros_1(profile, tmp_path):
    path = tmp_path / "run.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start(profile)
        transforms = Sent(S, "/tf", [Tf("map", "base", S, (1, 0, 0))])
        for one in (scan(S, 7), transforms, posed(S, 2.0, "/odom", ODOMETRY)):
            text, _ = store().generate_msgdef(one.msgtype, ros_version=2)
            schema = writer.register_schema(one.msgtype.replace("/msg/", "/"), "ros2msg", text.encode())
            channel = writer.register_channel(one.topic, "cdr", schema)
            writer.add_message(channel, one.log_ns, raw(one), one.log_ns)
        writer.finish()
    assert bag.load(path).lookup_transform("map", "base", S).transform.translation.x == 1.0
    posed_too = bag.load(path, poses={"/odom": ("odom", "b")})
    assert posed_too.lookup_transform("odom", "b", S).transform.translation.x == 2.0
    assert bag.stamps(path, "/scan").tolist() == [7]


def test_the_channels_of_a_topic_may_have_several_encodings(tmp_path):
    path = tmp_path / "run.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        for encoding, sent in (
            ("cdr", b"\0\1\0\0" + struct.pack("<iII", 5, 6, 1) + b"\0"),
            ("ros1", struct.pack("<IIII", 1, 7, 8, 0)),
        ):
            schema = writer.register_schema("std_msgs/Header", "ros1msg", b"time stamp\nstring frame_id\n")
            writer.add_message(writer.register_channel("/one", encoding, schema), 1, sent, 1)
        writer.finish()
    assert bag.stamps(path, "/one").tolist() == [5 * S + 6, 7 * S + 8]


def test_a_folder_of_several_encodings_is_read_file_by_file(tmp_path):
    path = write_folder(tmp_path / "run", drive())
    metadata = path / "metadata.yaml"
    metadata.write_text(
        metadata.read_text().replace("serialization_format: cdr", "serialization_format: json", 1)
    )
    text = "a topic is not in CDR, or .* load its files one by one: run.mcap$"
    with pytest.raises(bag.BagError, match=text):
        bag.load(path)
    assert bag.load(path / "run.mcap").can_transform("map", "base", 101 * S)


@pytest.mark.parametrize("schema", [b"\xb2\xff\x00", b"\x0a\x03abc", b"# caf\xe9\nint32 x\n"])
@pytest.mark.parametrize("encoding", ["protobuf", "flatbuffer", "ros2msg"])
@pytest.mark.parametrize("profile", ["", "ros2"])
def test_other_topics_may_have_any_schema(schema, encoding, profile, tmp_path):
    path = tmp_path / "run.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start(profile)
        other = writer.register_channel("/other", "cdr", writer.register_schema("x/msg/Y", encoding, schema))
        writer.add_message(other, 1, schema, 1)
        text, _ = store().generate_msgdef(TF, ros_version=2)
        tf = writer.register_channel("/tf", "cdr", writer.register_schema(TF, "ros2msg", text.encode()))
        writer.add_message(tf, S, raw(Sent(S, "/tf", [Tf("map", "base", S, (1, 2, 3))])), S)
        writer.finish()
    [(_, _, found)] = bag.transforms(path)
    assert found.transform.translation.z == 3.0


@pytest.mark.parametrize("form", ["mcap", "ros1", "foxglove"])  # one for each encoding of messages
def test_a_recorded_name_ends_at_a_nul(form, tmp_path):
    """As a received one does; some drivers in C++ send such names."""
    tf = [Sent(S, "/tf", [Tf("map\0\0", "base\0lidar", S, (1, 2, 3))])]
    assert set(bag.load(FORMATS[form](tmp_path, tf)).frames()) == {"map", "base"}


# What is kept.


def test_everything_is_kept_unless_a_cache_time_says_how_much(tmp_path, monkeypatch):
    monkeypatch.setenv("TF2_ROS_CYTHON_MAX_BYTES", "1000")
    last_ns = (2**31 - 1) * S
    stamps = [0, *(last_ns - i * S for i in range(4000, 0, -10)), last_ns]
    path = write_mcap(
        tmp_path / "run.mcap", [Sent(i, "/tf", [Tf("map", "base", ns)]) for i, ns in enumerate(stamps)]
    )
    assert bag.load(path).statistics()["samples"] == len(stamps)
    assert bag.load(path, cache_time=60).statistics()["samples"] < 10


def test_nothing_in_a_recording_has_an_age(tmp_path):
    buffer = bag.load(write_mcap(tmp_path / "run.mcap", DRIVE))
    with pytest.raises(ValueError, match="need a clock.* the buffer of a recording"):
        buffer.ages("map", "base")


def test_repeated_static_transforms_jumps_of_the_clock_and_refused_transforms_lose_nothing_else(tmp_path):
    again = [one._replace(log_ns=one.log_ns + 100 * S) for one in drive(5, begin_ns=50 * S)]
    spoiled = Sent(101 * S, "/tf", [Tf("map", "odom", 101 * S, (float("nan"), 0, 0)), Tf("", "odom", 0)])
    path = write_mcap(tmp_path / "run.mcap", [DRIVE[0], *DRIVE, spoiled, *again])
    buffer = bag.load(path)
    assert sum(buffer.statistics()["refused"].values()) == 2
    for seconds in (50.2, 102.0):
        assert buffer.can_transform_core("map", "lidar", round(seconds * S))[0]


# Times.


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("times")
    return [
        write_mcap(folder / "run.mcap", DRIVE),
        write_mcap(
            folder / "plain.mcap", sorted(DRIVE, key=lambda one: one.log_ns), index=False, chunked=False
        ),
        write_folder(folder / "run", DRIVE, "sqlite3"),
        write_ros1(folder / "run.bag", DRIVE),
        FORMATS["folder-mcap-chunk-index"](tmp_path_factory.mktemp("unindexed"), DRIVE),
    ]


LOG_TIMES = st.none() | st.sampled_from([one.log_ns for one in DRIVE]) | st.integers(99 * S, 106 * S)
LOG_TIMES |= st.sampled_from([-(2**63), 2**63 - 1])


@given(start=LOG_TIMES, end=LOG_TIMES, which=st.integers(0, 4))
@settings(max_examples=40)
def test_start_and_end_limit_dynamic_transforms_alone(recorded, start, end, which):
    if start is not None and end is not None and end < start:
        with pytest.raises(ValueError, match=r"^end: expected a time after start \(.* ns\), got .* ns$"):
            bag.load(recorded[which], start=start, end=end)
        return

    if (start is not None and start > DRIVE[-1].log_ns) or (end is not None and end < DRIVE[0].log_ns):
        check_lost(
            recorded[which],
            "nothing was recorded .*; its log times are 100.000 to 104.000 s.*nanoseconds",
            [
                lambda path: bag.load(path, start=start, end=end),
                lambda path: read_contents(path, wanted(start=start, end=end)),
                lambda path: flat_read(path, start=start, end=end),
            ],
        )
        return

    def is_wanted(one):
        return one[1] or ((start is None or one[0] >= start) and (end is None or one[0] <= end))

    expected = sorted(filter(is_wanted, flat(DRIVE)))
    assert sorted(flat_read(recorded[which], start=start, end=end)) == expected
    assert bag.load(recorded[which], start=start, end=end).statistics()["taken"] == len(expected)
    assert sorted(flat_heard(read_contents(recorded[which], wanted(start=start, end=end)))) == [
        one[:5] for one in expected
    ]


@pytest.mark.parametrize("name", ["start", "end"])
def test_an_error_about_a_time_names_the_argument(name, recorded):
    for time, got in ((101.5, r"101.5; round\(seconds \* 1e9\) converts seconds"), ("101", "'101'")):
        with pytest.raises(TypeError, match=f"^{name}: expected nanoseconds as an int, .*, got {got}$"):
            bag.load(recorded[0], **{name: time})


# Topics.

TWO = sorted(
    drive(10, prefix="/robot1") + drive(10, prefix="/robot2", begin_ns=100 * S + 50),
    key=lambda one: one.log_ns,
)


@pytest.mark.parametrize("form", ["mcap", "folder-sqlite3", "ros1"])
def test_topics_of_several_robots_load_with_a_prefix_each(form, tmp_path):
    path = FORMATS[form](tmp_path, TWO)
    topics = {
        f"/{name}/{topic}": f"{name}/" for name in ("robot1", "robot2") for topic in ("tf", "tf_static")
    }
    buffer = bag.load(path, topics=topics)
    plain = bag.load(path, topics=["/robot1/tf", "/robot1/tf_static", "/not/there"])
    np.testing.assert_equal(
        answers(buffer, ("robot1/map", "robot1/camera")), answers(plain, ("map", "camera"))
    )
    assert {frame.partition("/")[0] for frame in read_contents(path, wanted(topics)).frames} == {
        "robot1",
        "robot2",
    }


def test_a_prefix_replaces_the_slash_of_a_name_and_makes_no_name_of_none(tmp_path):
    messages = [Sent(1, "/tf", [Tf("/map", "/base", 1), Tf("map", "", 1)])]
    path = write_ros1(tmp_path / "run.bag", messages)
    assert {*bag.load(path, topics={"/tf": "r/"}).frames()} == {"r/map", "r/base"}
    assert flat_read(path, topics={"/tf": "r/"})[0][2:4] == ("r/map", "r/base")
    for prefix in ("/r/", "/"):
        assert {*bag.load(path, topics={"/tf": prefix}).frames()} == {f"{prefix[1:]}map", f"{prefix[1:]}base"}
    assert flat_read(path)[0][2:4] == ("/map", "/base")


@pytest.mark.parametrize("profile", ["ros1", "", "x"])
def test_messages_of_ros_1_in_an_mcap_are_those_of_a_bag(profile, tmp_path):
    messages = [*DRIVE, scan(105 * S, 104 * S, ros=1)]
    path = write_ros1_mcap(tmp_path / "run.mcap", messages, profile)
    assert bag.load(path).frames() == bag.load(write_ros1(tmp_path / "run.bag", messages)).frames()
    assert bag.stamps(path, "/scan").tolist() == [104 * S]
    assert {one.msgtype for one in opened_topics(path)} == {TF, SCAN}


def opened_topics(path):
    with open_recording(path) as recorded:
        return [*recorded.topics.values()]


def test_a_folder_named_like_a_file_of_a_recording_is_ignored(tmp_path):
    path = write_folder(tmp_path / "run", DRIVE)
    (path / "old.mcap").mkdir()
    assert sorted(flat_read(path)) == sorted(flat(DRIVE))


@pytest.mark.parametrize("name", ["run", "run.bag", "run.mcap", "run.db3", "run.bag.zstd"])
def test_a_folder_may_be_named_like_a_file(name, tmp_path):
    path = write_folder(tmp_path / "a", DRIVE).rename(tmp_path / name)
    assert sorted(flat_read(path)) == sorted(flat(DRIVE))
    (path / "metadata.yaml").write_text("{")
    check_lost(path, f"{name} is broken: .*; `ros2 bag reindex` may repair it$")


def test_a_topic_without_messages_gives_an_empty_buffer(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", [], topics=[("/tf", TF)])
    assert bag.load(path).statistics()["taken"] == 0
    assert flat_read(path) == []
    heard = read_contents(path)
    assert (len(heard.records), heard.start_ns, heard.end_ns) == (0, None, None)


# Whatever cannot be read.


def check_lost(path, text, functions=(bag.load, read_contents, flat_read)):
    """However it is read, it is an error in one line."""
    for function in functions:
        with pytest.raises(bag.BagError, match=text) as raised:
            function(path)
        assert "\n" not in str(raised.value)


def changed(path, change):
    path.write_bytes(change(path.read_bytes()))


def spoiled(data, at, size=60):
    return data[:at] + bytes(one ^ 0x5A for one in data[at : at + size]) + data[at + size :]


BROKEN = "{path}.* is broken.*; `{tool}.*` may repair it$"
FAULTS = {
    "empty": (lambda data: b"", "{path} is empty$"),
    "text": (
        lambda data: b"hello\n" * 99,
        r"{path} is not a recording: it does not begin as \.\w+ files do$",
    ),
    "half": (lambda data: data[: len(data) // 2], "{folder}.* is broken.*; `{tool}.*` may repair it$"),
    "end": (lambda data: data[: len(data) * 49 // 50], "{folder}.* is broken.*; `{tool}.*` may repair it$"),
    "last byte": (lambda data: data[:-1], "{folder}.* is broken.*; `{tool}.*` may repair it$"),
    "middle": (lambda data: spoiled(data, len(data) // 2, 300), "is broken.*; `{tool}.*` may repair it$"),
}
TOOLS = {".mcap": "mcap recover", ".db3": "sqlite3 FILE .recover", ".bag": "rosbag reindex"}
# One of each library, with and without an index, in a folder, and compressed as a whole.
FAULTY = ("mcap", "mcap-no-index", "mcap-file", "folder-sqlite3", "split-mcap-file", "ros1", "foxglove")


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("form", FAULTY)
def test_a_fault_of_a_file_is_an_error_that_names_it_and_the_tool(form, fault, tmp_path):
    if fault == "middle" and form == "split-mcap-file":
        pytest.skip("its parts have neither checksums nor a structure in their middle")
    path = FORMATS[form](tmp_path, drive(400))
    file = max(one for one in path.iterdir() if one.suffix != ".yaml") if path.is_dir() else path
    change, text = FAULTS[fault]
    changed(file, change)
    tool = TOOLS[os.path.splitext(file.name.removesuffix(".zstd"))[1]]
    check_lost(path, text.format(folder=path, path=file, tool=tool))


def lost_record(path, opcode, at):
    """Spoil the opcode of a record of an .mcap, the first one like it from a place on."""

    def change(data):
        begin = at(data)
        while data[begin] != opcode:
            begin += 9 + int.from_bytes(data[begin + 1 : begin + 9], "little")
        return data[:begin] + bytes([opcode ^ 0x40]) + data[begin + 1 :]

    changed(path, change)
    return path


def lost_message(path, sent):
    return lost_record(path, 5, lambda data: data.index(raw(sent)) - 31)  # after the head of its record


def lost_chunk(path):
    return lost_record(path, 8, lambda data: int.from_bytes(data[-28:-20], "little"))  # in the summary


def folder_without_a_message(at):
    path = write_folder(at / "run.mcap", DRIVE)
    lost_message(path / "run.mcap.mcap", DRIVE[7])
    return path


@pytest.mark.parametrize(
    "write",
    [
        lambda at: lost_message(write_mcap(at, DRIVE, chunked=False), DRIVE[7]),
        lambda at: lost_message(write_mcap(at, DRIVE, chunked=False), DRIVE[0]),  # static
        lambda at: lost_chunk(write_mcap(at, DRIVE)),
        lambda at: lost_chunk(write_ros1_mcap(at, DRIVE)),
        lambda at: lost_chunk(write_foxglove(at, DRIVE)),
        lambda at: folder_without_a_message(at.parent),
    ],
)
def test_fewer_messages_than_the_index_counts_are_an_error(write, tmp_path):
    text = r"topic /tf\w*: its index counts \d+ messages, but \d+ can be read; `.*` may repair it$"
    check_lost(write(tmp_path / "run.mcap"), rf"run.mcap is broken, {text}")


def test_fewer_stamps_than_the_index_counts_are_an_error(tmp_path):
    scans = [scan(ns * S, ns * S) for ns in range(100, 104)]
    path = lost_message(write_mcap(tmp_path / "run.mcap", [*DRIVE, *scans], chunked=False), scans[2])
    text = "topic /scan: its index counts 4 messages, but 3 can be read; `mcap recover` may repair it$"
    check_lost(path, text, [lambda path: bag.stamps(path, "/scan")])
    assert sorted(flat_read(path)) == sorted(flat(DRIVE)), "other topics are complete"


def test_what_a_damaged_file_still_has_is_read_between_times(tmp_path):
    path = lost_message(write_mcap(tmp_path / "run.mcap", DRIVE, chunked=False), DRIVE[7])
    assert len(flat_read(path, start=0)) == len(flat(DRIVE)) - len(DRIVE[7].content)


QOS = """\
- {history: 3, depth: 9, reliability: 1, durability: 2, deadline: {sec: 9, nsec: 0},
   lifespan: {sec: 9, nsec: 0}, liveliness: 1, liveliness_lease_duration: {sec: 9, nsec: 0},
   avoid_ros_namespace_conventions: false}
"""
# What a metadata.yaml may say of a recording, by the key of rosbag2 and of its topics.
WRONG = {
    "it ends later": {"duration": {"nanoseconds": 8000 * S}},
    "it begins earlier": {"starting_time": {"nanoseconds_since_epoch": 0}},
    "it begins later and is empty": {
        "starting_time": {"nanoseconds_since_epoch": 9000 * S},
        "duration": {"nanoseconds": 0},
    },
    "there are no messages": {"message_count": 0},
    "no topic has messages": {"of topics": {"message_count": 0}},
    "each topic has a million": {"message_count": 3_000_000, "of topics": {"message_count": 1_000_000}},
    "there are no topics": {"topics_with_message_count": []},
    "the topics have another type": {"of topics": {"type": STRING}},
    "the topics have another quality of service": {"of topics": {"offered_qos_profiles": QOS}},
}


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize(
    "form", ["folder-mcap-message", "folder-sqlite3", "split-mcap-file", "split-sqlite3"]
)
def test_a_folder_is_what_its_files_hold_whatever_its_metadata_says(form, wrong, tmp_path):
    path = FORMATS[form](tmp_path, [*DRIVE, scan(300 * S, 300 * S)])
    heard = read_contents(path)
    expected = report(heard)
    with open_recording(path) as recorded:
        described = (recorded.start_ns, recorded.end_ns, recorded.topics)
    assert described[:2] == (100 * S, 300 * S)
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())
    content = metadata["rosbag2_bagfile_information"]
    changes = dict(WRONG[wrong])
    of_topics = changes.pop("of topics", {})
    for topic in content["topics_with_message_count"]:
        for key, value in of_topics.items():
            (topic if key in topic else topic["topic_metadata"])[key] = value
    content.update(changes)
    (path / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    with open_recording(path) as recorded:
        assert (recorded.start_ns, recorded.end_ns, recorded.topics) == described
    found = read_contents(path)
    assert bool(found.notes) == (wrong == "each topic has a million")
    assert report(replace(found, notes=[])) == expected
    assert found.records.tolist() == heard.records.tolist()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert sorted(flat_read(path)) == sorted(flat(DRIVE))
        assert bag.stamps(path, "/scan").tolist() == [300 * S]


def test_a_folder_with_fewer_messages_than_its_metadata_counts_is_a_warning(tmp_path):
    path = write_split(tmp_path / "run", [*DRIVE, scan(300 * S, 300 * S)], "sqlite3")
    with closing(sqlite3.connect(path / "run_2.db3")) as database, database:
        database.execute("delete from messages")
    text = r"metadata.yaml counts {}, but the files have {}: some are lost, or `ros2 bag reindex` corrects it"
    tf, scans = text.format("40 messages on /tf", 29), text.format("1 message on /scan", 0)
    static = text.format("2 messages on /tf_static", 1)
    for read, texts in (
        (lambda: bag.load(path), [tf, static]),
        (lambda: [*bag.transforms(path)], [tf, static]),
        (lambda: bag.load(path, topics=["/tf"]), [tf]),
        (lambda: bag.stamps(path, "/scan"), [scans]),
    ):
        with pytest.warns(UserWarning) as warned:
            read()
        assert [str(one.message) for one in warned] == [f"{path}: {text}" for text in texts]
    heard = read_contents(path, at="/scan")
    assert heard.notes == [tf, static, scans]
    assert {tf, static} <= {one.text for one in report(heard).findings}
    with closing(sqlite3.connect(path / "run_1.db3")) as database, database:
        database.execute("delete from topics")
    check_lost(path, "run_1.db3 is broken: 15 messages of no topic; `sqlite3 FILE .recover` may repair it$")


def test_a_topic_without_messages_is_listed_from_the_metadata(tmp_path):
    path = write_folder(tmp_path / "run", [scan(1, 1)])
    with rosbag2.Writer(tmp_path / "empty", version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        writer.add_connection("/tf", TF, typestore=store())
    empty = yaml.safe_load((tmp_path / "empty" / "metadata.yaml").read_text())
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())
    listed = metadata["rosbag2_bagfile_information"]["topics_with_message_count"]
    listed += empty["rosbag2_bagfile_information"]["topics_with_message_count"]
    (path / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    with open_recording(path) as recorded:
        assert {name: one.count for name, one in recorded.topics.items()} == {"/scan": 1, "/tf": 0}
    assert bag.load(path).statistics()["taken"] == 0


def split(folder, change):
    path = write_split(folder / "run", DRIVE)
    change(path)
    return path


def file(folder, name, content=b"text"):
    (folder / name).write_bytes(content)
    return folder / name


def with_storage(folder, line, storage):
    path = write_folder(folder / "run", DRIVE, storage, "file")
    content = (path / "metadata.yaml").read_text()
    changed = re.sub("storage_identifier: .*", line, content)
    assert changed != content
    (path / "metadata.yaml").write_text(changed)
    return path


def renamed(folder):
    path = write_folder(folder / "run", DRIVE, "sqlite3")
    (path / "run.db3").rename(path / "kitchen.db3")
    return path


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 990\n"


def spoiled_db3(folder, statement):
    path = write_db3(folder / "run.db3", DRIVE)
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(statement)
    return path


LAST = "where id = (select max(id) from messages)"


def with_metadata(folder, old, new):
    path = write_folder(folder / "run", DRIVE)
    content = (path / "metadata.yaml").read_bytes()
    assert old in content
    (path / "metadata.yaml").write_bytes(content.replace(old, new, 1))
    return path


def unmerged(folder):
    file(folder, "run.db3-wal")
    return write_db3(folder / "run.db3", DRIVE)


def interrupted(folder):
    """A copy of a database in the middle of a change, as a crash leaves it."""
    path = write_db3(folder / "old.db3", DRIVE)
    with closing(sqlite3.connect(path)) as database, closing(database.cursor()) as cursor:
        cursor.execute("pragma cache_size = 1")
        cursor.execute("update messages set data = zeroblob(9000)")
        shutil.copy(f"{path}-journal", folder / "run.db3-journal")
        return shutil.copy(path, folder / "run.db3")


def test_a_journal_that_is_over_changes_nothing(tmp_path):
    path = write_db3(tmp_path / "run.db3", DRIVE)
    file(tmp_path, "run.db3-journal", bytes(512))  # as the mode "persist" leaves it
    assert sorted(flat_read(path)) == sorted(flat(DRIVE))


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.filterwarnings("ignore:.*metadata.yaml counts")  # what is merged later deletes messages
def test_what_is_not_merged_beside_the_target_of_a_link_is_missed(whole, tmp_path):
    folder = write_folder(tmp_path / "run", DRIVE, "sqlite3")
    (tmp_path / "kept").mkdir()
    kept = (folder / "run.db3").rename(tmp_path / "kept" / "run.db3")
    (folder / "run.db3").symlink_to(kept)
    path = folder if whole else folder / "run.db3"
    before = answers(bag.load(path))
    with closing(sqlite3.connect(kept)) as database:
        database.execute("pragma journal_mode = wal")  # as rosbag2's preset "resilient" does
        database.execute("delete from messages where id > 12")
        database.commit()
        check_lost(path, "run.db3 is incomplete without run.db3-wal: .* merges it")
    assert str(answers(bag.load(path))) == str(answers(bag.load(kept))) != str(before)


def test_names_may_have_the_longest_length(tmp_path):
    """Longer by one of SQLite's endings, they would name no file."""
    path = write_mcap(tmp_path / f"{'x' * 250}.mcap", DRIVE)
    np.testing.assert_equal(answers(bag.load(path)), EXPECTED)


@pytest.mark.parametrize(
    ("write", "text"),
    [
        # Folders whose parts do not fit together.
        (
            lambda at: split(at, lambda run: (run / "metadata.yaml").unlink()),
            "run is not a recording: the folder has no metadata.yaml; `ros2 bag reindex` makes",
        ),
        (
            lambda at: split(at, lambda run: (run / "run_1.mcap").unlink()),
            "run is broken: .*files are missing: .*run_1.mcap.*; `ros2 bag reindex` may repair",
        ),
        (lambda at: split(at, lambda run: file(run, "metadata.yaml", b"{")), "run is broken: .*reindex"),
        (
            renamed,
            r"run is broken: .* missing: \['.*/run.db3'\]; it has kitchen.db3 instead; `ros2 bag reindex`",
        ),
        *(
            (
                lambda at, line=line, storage=storage: with_storage(at, line, storage),
                f"run is broken: storage_identifier in metadata.yaml must be {storage}, as of run.",
            )
            for storage, other in (("mcap", "sqlite3"), ("sqlite3", "mcap"))
            for line in (*(f"storage_identifier: {one}" for one in ("''", "null", "x", other)), "x: mcap")
        ),
        # Parts of a file.
        (
            lambda at: spoiled_db3(at, f"update messages set data = x'0001' {LAST}"),
            "run.db3, topic /tf_static, log time 104000000000 ns: malformed TFMessage",
        ),
        *(
            (
                lambda at, damage=damage: spoiled_db3(at, damage),
                r"run.db3 is broken: \d+ messages? of no topic; `sqlite3 FILE .recover` may repair it$",
            )
            for damage in (
                f"update messages set topic_id = 99 {LAST}",
                "delete from topics where name = '/tf_static'",
                "delete from topics",
            )
        ),
        (
            lambda at: split(at, lambda run: write_foxglove(run / "run_1.mcap", DRIVE)),
            "run: a topic is not in CDR, .*; load its files one by one: run_0.mcap, run_1.mcap, run_2.mcap$",
        ),
        # SQLite and YAML accept any type.
        *(
            (
                lambda at, column=column: spoiled_db3(at, f"update topics set {column} = x'ff00'"),
                r"run.db3 is broken: .* of a topic is b'\\xff\\x00', which .*; `sqlite3 FILE .recover`",
            )
            for column in ("name", "type", "serialization_format")
        ),
        *(
            (
                lambda at, value=value: spoiled_db3(at, f"update messages set {value} {LAST}"),
                f"run.db3 is broken, .*: the log time of a message is {text}; `sqlite3 FILE .recover`",
            )
            for value, text in (
                ("timestamp = 'x'", "'x', and its data is bytes"),
                ("data = 'x'", "104000000000, and its data is str"),
            )
        ),
        (
            lambda at: with_metadata(at, b"name: /tf_static", b"name: 5"),
            "run is broken: the name, type or encoding of a topic is 5, which .*; `ros2 bag reindex`",
        ),
        (
            lambda at: with_metadata(at, b"/tf_static", b"/tf_\xff\xfe"),
            "run is broken: its metadata.yaml is not in UTF-8; `ros2 bag reindex` may repair it$",
        ),
        (unmerged, "run.db3 is incomplete without run.db3-wal: `sqlite3 run.db3 .* merges it"),
        (interrupted, "run.db3 is incomplete without run.db3-journal: `sqlite3 run.db3 .* merges it"),
        (
            lambda at: write_mcap(at / "run.mcap", DRIVE[::-1], index=False, chunked=False),
            "run.mcap is broken, .* not in timestamp order.*; `mcap recover`",
        ),
        # Other topics.
        (
            lambda at: write_mcap(at / "run.mcap", TWO),
            "has no topic /tf or /tf_static; its topics with transforms: /robot1/tf, /robot1/tf_static",
        ),
        (
            lambda at: write_mcap(at / "run.mcap", [Sent(1, "/tf", {"data": "hello"}, STRING)]),
            "run.mcap, topic /tf: expected the type tf2_msgs/msg/TFMessage, got std_msgs",
        ),
        # What is not a recording.
        (lambda at: at, "is not a recording: the folder has no metadata.yaml"),
        (lambda at: os.mkfifo(at / "run.mcap") or at / "run.mcap", "run.mcap is a pipe or a device"),
        (
            lambda at: file(at, "a.tf2"),
            "a.tf2 is not a recording: it is a frozen buffer, which `tf2_ros.Buffer.open` reads$",
        ),
        (lambda at: file(at, "a.txt"), "a.txt is not a recording: expected a folder with a metadata.yaml"),
        (
            lambda at: write_ros1(at / "run.bag", drive()).rename(at / "run.bag.active"),
            "run.bag.active was not closed by its recorder: `rosbag reindex` repairs it; then remove .active",
        ),
        (
            lambda at: write_mcap(at / "run.mcap", drive()).rename(at / "run.db3"),
            r"run.db3 is not a recording: .* as \.db3 files do, but as \.mcap files do: rename it$",
        ),
        (
            lambda at: packed(write_db3(at / "run.db3", drive())).rename(at / "run.bag.zstd"),
            r"run.bag.zstd is not a recording: .* as \.bag files do, but as \.db3 files do: rename it$",
        ),
        # What a clone has in place of a recording.
        *(
            (
                lambda at, name=name: file(at, name, POINTER),
                f"{name} is a pointer of Git LFS.*`git lfs pull`",
            )
            for name in ("a.mcap", "a.db3", "a.bag", "a.mcap.zstd")
        ),
        (
            lambda at: split(at, lambda run: file(run, "run_1.mcap", POINTER)),
            "run/run_1.mcap is a pointer of Git LFS, not the recording: `git lfs pull` downloads the",
        ),
        (
            lambda at: split(at, lambda run: file(run, "metadata.yaml", POINTER)),
            "run/metadata.yaml is a pointer of Git LFS, .* `git lfs pull` downloads the recording$",
        ),
    ],
)
def test_what_cannot_be_read_is_explained(write, text, tmp_path):
    check_lost(write(tmp_path), text)


@pytest.mark.parametrize(
    ("topic", "text"),
    [
        ("/no", "topic /no: this topic does not exist; the topics are /bad, /odd, /scan, /tf_static$"),
        ("/tf_static", "topic /tf_static: tf2_msgs/msg/TFMessage does not begin with a std_msgs/m"),
        ("/bad", "run.mcap, topic /bad, log time 101000000000 ns: "),
        ("/odd", "run.mcap is broken, topic /odd, definition of its type: "),
    ],
)
def test_stamps_that_cannot_be_read_are_explained(topic, text, tmp_path):
    messages = [DRIVE[0], *(scan(100 * S, 90 * S, topic) for topic in ("/scan", "/bad"))]
    messages += [messages[-1]._replace(log_ns=101 * S, content=b""), Sent(S, "/odd", {"data": ""}, STRING)]
    path = write_mcap(tmp_path / "run.mcap", messages, chunked=False)
    changed(path, lambda data: data.replace(b"string data", b"string d+ta"))
    check_lost(path, text, [lambda path: bag.stamps(path, topic)])


# Progress, and the end of a load.


def test_a_bar_counts_the_messages(tmp_path, capfd):
    path = write_mcap(tmp_path / "run.mcap", drive(600))
    bag.load(path, progress=True)
    assert "602/602" in capfd.readouterr().err
    bag.load(path, progress=False)
    bag.load(path)  # standard error is no terminal
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("wrong", ["no", 0.0001, 0, []], ids=repr)
def test_what_is_no_bool_is_refused(wrong, tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE)
    text = f"expected a bool, got {type(wrong).__name__}$"
    with pytest.raises(TypeError, match=f"^progress: {text}"):
        bag.load(path, progress=wrong)
    with pytest.raises(TypeError, match=f"^progress: {text}"):
        bag.dataset(path, ["base"], at="/tf", relative_to="map", progress=wrong)
    for name in ("records", "keeps_uncorrected"):
        with pytest.raises(TypeError, match=f"^{name}: {text}"):
            read_contents(path, **{name: wrong})
    for name in ("only_transforms", "progress"):
        with pytest.raises(TypeError, match=f"^{name}: {text}"):
            bag.rewrite(path, tmp_path / "new.mcap", **{"drop": ["base"], name: wrong})
    with open_recording(path) as recorded, pytest.raises(TypeError, match=f"^convert: {text}"):
        recorded.raw(["/tf"], convert=wrong)


@pytest.mark.parametrize("module", ["tqdm", "rosbags"])
def test_a_missing_library_is_named_with_its_extra(module, tmp_path, monkeypatch):
    path = write_mcap(tmp_path / "run.mcap", DRIVE)
    monkeypatch.setitem(sys.modules, module, None)
    advice = rf"{module} is not installed: pip install 'tf2-ros-tools\[bag\]'"
    with pytest.raises(ModuleNotFoundError, match=advice):
        bag.load(path)


@pytest.mark.parametrize("module", ["mcap", "rosbags", "tqdm"])
def test_a_missing_library_is_named_by_the_import(module):
    """Not by `save`, after a program has recorded for its whole time."""
    code = f"import sys; sys.modules[{module!r}] = None; from tf2_ros_tools import bag; print('recording')"
    done = run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.endswith(f"{module} is not installed: pip install 'tf2-ros-tools[bag]'\n")


def test_a_recording_is_closed_after_an_error_and_an_abandoned_iteration(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", DRIVE)
    before = os.listdir("/proc/self/fd")
    iterator = bag.transforms(path)
    next(iterator)
    iterator.close()
    changed(path, lambda data: data[: len(data) // 2])
    check_lost(path, "is broken")
    assert os.listdir("/proc/self/fd") == before
