# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Saved buffers are ordinary recordings, which have the samples to the last bit."""

import os
import resource

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pickles_and_copies import HISTORIES, filled, held
from rclpy.duration import Duration
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from rosbags.typesys import Stores, get_typestore
from times_and_transforms import rotation, stamp_ns, transform, translation

from tf2_py import BufferCore
from tf2_ros_tools import bag
from tf2_ros_tools.recordings import saved_buffers


@pytest.fixture
def buffer():
    return filled(BufferCore())


def samples(buffer):
    """What a recording has of a buffer, to the last bit."""
    return {what: value for what, value in held(buffer).items() if what not in ("yaml", "settings")}


@pytest.fixture
def path(buffer, tmp_path):
    path = tmp_path / "robot.mcap"
    bag.save(buffer, path)
    return path


def test_an_opened_buffer_is_saved_with_its_contents(buffer, tmp_path):
    """The file from which it was opened may be gone."""
    buffer.freeze(tmp_path / "robot.tf2")
    opened = BufferCore.open(tmp_path / "robot.tf2")
    (tmp_path / "robot.tf2").unlink()
    bag.save(opened, tmp_path / "opened.mcap")
    assert samples(bag.load(tmp_path / "opened.mcap")) == samples(buffer)


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


@pytest.mark.parametrize("at_once", [7, saved_buffers.AT_ONCE])
def test_several_transforms_share_a_message(at_once, tmp_path, monkeypatch):
    monkeypatch.setattr(saved_buffers, "AT_ONCE", at_once)
    buffer = BufferCore()
    for i in range(100):
        buffer.set_transforms([transform("map", f"f{k}", ns=i * 1_000_000) for k in range(30)], "x")
    bag.save(buffer, tmp_path / "many.mcap")
    with open(tmp_path / "many.mcap", "rb") as file:
        assert make_reader(file).get_summary().statistics.message_count == 10
    assert bag.load(tmp_path / "many.mcap").frames() == buffer.frames()


# What is written, or not.


def test_a_file_is_replaced_or_as_before_and_nothing_else_is_left(buffer, tmp_path):
    path = tmp_path / ("r" * 250 + ".mcap")  # the longest name
    bag.save(BufferCore(), path)
    assert bag.load(path).frames() == {}
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
    assert samples(bag.load(str(path))) == samples(buffer)
    assert [*tmp_path.iterdir()] == [path]


def test_a_path_that_cannot_be_written(buffer, tmp_path):
    with pytest.raises(FileNotFoundError, match="no folder/a.mcap"):
        bag.save(buffer, tmp_path / "no folder" / "a.mcap")


@pytest.mark.parametrize("at_once", [3, saved_buffers.AT_ONCE])
@pytest.mark.parametrize("history", HISTORIES)
def test_a_loaded_file_has_the_samples_of_the_buffer(history, at_once, tmp_path, monkeypatch):
    monkeypatch.setattr(saved_buffers, "AT_ONCE", at_once)
    buffer = BufferCore(Duration(seconds=20))
    for i, (parent, child, seconds) in enumerate(HISTORIES[history]):
        buffer.set_transform(transform(parent, child, seconds, (i, 0, 0)), "x")
    bag.save(filled(buffer), tmp_path / "saved.mcap")
    assert samples(bag.load(tmp_path / "saved.mcap")) == samples(buffer)
