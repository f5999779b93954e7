# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Saved buffers are ordinary recordings, and spoiled ones are refused."""

import os
import resource

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from pickles_and_copies import HISTORIES, check_copy, filled, held
from processes import output_of
from rclpy.duration import Duration
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from rosbags.typesys import Stores, get_typestore
from times_and_transforms import rotation, stamp_ns, transform, translation

from tf2_py import BufferCore
from tf2_ros import Buffer
from tf2_ros_tools import bag


@pytest.fixture
def buffer():
    return filled(BufferCore())


def load(path):
    return bag.load_saved(path, BufferCore)


@pytest.fixture
def path(buffer, tmp_path):
    path = tmp_path / "robot.mcap"
    bag.save(buffer, path)
    return path


def test_an_opened_buffer_is_saved_with_its_contents(buffer, tmp_path):
    """Also one that a cache has opened: its pickle is only a path."""
    buffer.freeze(tmp_path / "robot.tf2")
    bag.save(BufferCore.open(tmp_path / "robot.tf2"), tmp_path / "opened.mcap")
    bag.save(buffer, tmp_path / "robot.mcap")
    assert held(load(tmp_path / "opened.mcap")) == held(load(tmp_path / "robot.mcap"))


REPLACING = """
import os
import sys

from tf2_py import BufferCore
from tf2_ros_tools import bag

path, other, saved = sys.argv[1:]
buffer = BufferCore.open(path)


def replace(event, arguments):
    name = arguments[0] if event == "open" else None
    if isinstance(name, str) and os.path.realpath(name) == path and os.path.exists(path):
        os.replace(other, path) if os.path.exists(other) else os.unlink(path)


sys.addaudithook(replace)
bag.save(buffer, saved)
"""


@pytest.mark.parametrize("what", ["replaced", "deleted"])
def test_a_file_that_is_replaced_meanwhile_is_not_saved(buffer, tmp_path, what):
    path, other, saved = (tmp_path / name for name in ("robot.tf2", "other.tf2", "opened.mcap"))
    buffer.freeze(path)
    bag.save(BufferCore.open(path), tmp_path / "robot.mcap")
    if what == "replaced":
        BufferCore().freeze(other)
    output_of("-c", REPLACING, path, other, saved)
    assert held(load(saved)) == held(load(tmp_path / "robot.mcap"))


def tampered(path, change):
    """A whole file again, with other messages or metadata: `change` gets and returns both."""
    with open(path, "rb") as file:
        reader = make_reader(file)
        [metadata] = [one.metadata for one in reader.iter_metadata()]
        messages = [(channel.topic, m.log_time, m.data) for _, channel, m in reader.iter_messages()]
    metadata, messages = change(metadata, messages)
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        if metadata is not None:
            writer.add_metadata("tf2_ros_cython.buffer", metadata)
        schema = writer.register_schema("tf2_msgs/msg/TFMessage", "ros2msg", b"")
        for topic, log_time, data in messages:
            channel = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channel, log_time, data, log_time)
        writer.finish()


def with_metadata(**changes):
    return lambda metadata, messages: (metadata | changes, messages)


def test_other_readers_read_the_same_transforms(path, buffer):
    def told(t):
        return t.header.frame_id, t.child_frame_id, stamp_ns(t), *translation(t), *rotation(t)

    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])  # by the schema in the file
        assert reader.get_header().profile == "ros2"
        by_mcap = [
            (channel.topic, message.log_time, told(t))
            for _, channel, message, ros in reader.iter_decoded_messages()
            for t in ros.transforms
        ]
    store = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([path]) as reader:
        by_rosbags = [
            (connection.topic, log_time, told(t))
            for connection, log_time, raw in reader.messages()
            for t in store.deserialize_cdr(raw, connection.msgtype).transforms
        ]
        [static] = [c for c in reader.connections if c.topic == "/tf_static"]
        assert static.ext.offered_qos_profiles[0].durability == QosDurability.TRANSIENT_LOCAL
    assert by_mcap == by_rosbags and len(by_mcap) == buffer.statistics()["samples"]
    # Static ones first, then in the order of the stamps, no later than 10 ms after each.
    assert [topic for topic, _, _ in by_mcap] == ["/tf_static"] * 2 + ["/tf"] * (len(by_mcap) - 2)
    stamps = [(log_time, t[2]) for _, log_time, t in by_mcap[2:]]
    assert stamps == sorted(stamps, key=lambda row: row[1])
    assert all(0 <= log_time - stamp < 10_000_000 for log_time, stamp in stamps)


def test_several_transforms_share_a_message(tmp_path):
    buffer = BufferCore()
    for i in range(100):
        buffer.set_transforms([transform("map", f"f{k}", ns=i * 1_000_000) for k in range(30)], "x")
    bag.save(buffer, tmp_path / "many.mcap")
    with open(tmp_path / "many.mcap", "rb") as file:
        assert make_reader(file).get_summary().statistics.message_count == 10
    assert load(tmp_path / "many.mcap").frames() == buffer.frames()


# What is written, or not.


def test_a_file_is_replaced_or_as_before_and_nothing_else_is_left(buffer, tmp_path):
    path = tmp_path / ("r" * 250 + ".mcap")  # the longest name
    bag.save(BufferCore(), path)
    before, (limit, most) = path.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, most))  # as a full disk
    try:
        with pytest.raises(OSError, match="File too large") as refused:
            bag.save(buffer, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, most))
    assert (refused.value.filename, path.read_bytes()) == (str(path), before)
    assert [*tmp_path.iterdir()] == [path]
    bag.save(buffer, os.fsencode(path))
    check_copy(load(str(path)), buffer)
    assert [*tmp_path.iterdir()] == [path]


def test_a_path_that_cannot_be_written_or_read(buffer, tmp_path):
    for path in (tmp_path / "no folder" / "a.mcap", tmp_path / "gone.mcap"):
        with pytest.raises(FileNotFoundError, match=path.name):
            load(path)
    with pytest.raises(FileNotFoundError, match="no folder/a.mcap"):
        bag.save(buffer, tmp_path / "no folder" / "a.mcap")


@pytest.mark.parametrize("history", HISTORIES)
def test_a_file_holds_what_the_buffer_holds(history, tmp_path, no_refusals_logged):
    for limits in ({}, {"max_frames": 7}, {"max_bytes": 5_000}):
        buffer = BufferCore(Duration(seconds=20), **limits)
        for i, (parent, child, seconds) in enumerate(HISTORIES[history]):
            buffer.set_transform(transform(parent, child, seconds, (i, 0, 0)), "x")
        bag.save(filled(buffer), tmp_path / "saved.mcap")
        check_copy(load(tmp_path / "saved.mcap"), buffer)


class Robot(Buffer):
    """With another constructor, and attributes, which a file does not have."""

    def __init__(self, name):
        super().__init__()
        self.name = name


@pytest.mark.parametrize("kind", [Buffer, Robot])
def test_the_class_is_the_callers_and_its_init_is_not_called(kind, tmp_path):
    robot = Robot("r1")
    robot.set_transform(transform("map", "odom", 1, (1, 2, 3)), "x")
    bag.save(robot, tmp_path / "robot.mcap")
    arrived = bag.load_saved(tmp_path / "robot.mcap", *([kind] if kind is Robot else []))
    assert type(arrived) is kind and not hasattr(arrived, "name")
    assert translation(arrived.lookup_transform("map", "odom", 1_000_000_000)) == (1, 2, 3)


# What is refused.


def test_a_damaged_file_is_refused_by_name(path, buffer, tmp_path):
    whole = path.read_bytes()
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(b"hello")
    with pytest.raises(ValueError, match="damaged.mcap: "):
        load(damaged)
    refused = 0
    for at in range(0, len(whole), 7):
        # Cut off there, another bit, and a length beyond the end, for which no memory is asked.
        for there in (
            b"",
            bytes([whole[at] ^ 0x55]) + whole[at + 1 :],
            (1 << 62).to_bytes(8, "little") + whole[at + 8 :],
        ):
            data = whole[:at] + there
            damaged.write_bytes(data)
            try:
                loaded = load(damaged)
            except ValueError as error:
                assert "damaged.mcap: " in str(error)
                refused += 1
            else:  # the summary at the end of the file is not needed
                check_copy(loaded, buffer)
    assert refused > len(whole) // 7


# How metadata and messages are changed, by what is said of that.
REFUSED = {
    "not contain a buffer written by save..; tf2_ros_tools.bag.load": lambda data, messages: (None, messages),
    "not contain a buffer written by save": lambda data, messages: (None, []),
    "lacks samples": lambda data, messages: (data.pop("samples") and data, messages),
    "Expecting value": with_metadata(cache_time_ns="two"),
    "its metadata lists 11 transforms, its messages contain 10": lambda data, messages: (data, messages[:-1]),
    "and its messages contain different frames": with_metadata(authorities="{}"),
    "has no attribute 'keys'": with_metadata(authorities="7"),
    "max_bytes: expected an int": with_metadata(max_bytes='"all"'),
    "malformed TFMessage: the data ends": lambda data, messages: (
        data,
        [(*messages[0][:2], messages[0][2][:-9])],
    ),
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_file_of_something_else_is_refused_by_name(why, path):
    tampered(path, REFUSED[why])
    with pytest.raises(ValueError, match=f"robot.mcap: .*{why}"):
        load(path)
