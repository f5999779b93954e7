# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Serialized messages of any source, which `insert_messages` inserts and records."""

import pytest
from cdr_encoder import encode
from pickles_and_copies import image_of
from times_and_transforms import S, transform

from tf2_py import BufferCore
from tf2_ros.records import Recording
from tf2_ros.serialization import MessageSource, insert_messages

MESSAGES = [
    ("/tf_static", 100 * S, encode([transform("base", "camera")])),
    *(
        ("/tf", seconds * S, encode([transform("map", "odom", seconds), transform("odom", "base", seconds)]))
        for seconds in (101, 102)
    ),
]
SOURCES = [MessageSource("/tf"), MessageSource("/tf_static", True)]


def test_what_a_small_recording_has_no_place_for_comes_in_arrays():
    recording, arrays = Recording(3), []
    insert_messages(BufferCore(), MESSAGES, SOURCES, recording=recording, records=arrays)
    assert [len(one) for one in (*arrays, recording.take())] == [3, 2]
    assert recording.lost == 0


def test_a_publisher_is_recorded_instead_of_the_topic():
    recording, sources = Recording(), [MessageSource("/tf", publisher=b"\x00\x01"), SOURCES[1]]
    buffer = BufferCore()
    insert_messages(buffer, MESSAGES, sources, recording=recording)
    assert recording.publishers() == [b"/tf_static", b"\x00\x01"]
    assert recording.take()["publisher"].tolist() == [0, 1, 1, 1, 1]
    assert "broadcaster: '/tf'" in buffer.all_frames_as_yaml()


def test_messages_that_are_inserted_together_are_of_one_topic():
    """Without a recording, several are."""
    together, one_by_one = BufferCore(), BufferCore()
    messages = [*MESSAGES, *MESSAGES]
    insert_messages(together, messages, SOURCES)
    for message in messages:
        insert_messages(one_by_one, [message], SOURCES)
    assert image_of(together) == image_of(one_by_one)


def test_the_frames_of_each_topic_get_its_prefix():
    buffer, sources = (
        BufferCore(),
        [MessageSource("/tf", prefix="a/"), MessageSource("/tf_static", True, "b/")],
    )
    recording = Recording()
    insert_messages(buffer, MESSAGES, sources, recording=recording)
    assert {*buffer.frames()} == {*recording.frames()} == {"a/map", "a/odom", "a/base", "b/base", "b/camera"}


def test_the_numbers_of_static_transforms_are_noted_once_each():
    first, moved, turn = (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (0.0, 0.0, 0.6, 0.8)
    camera = [transform("base", "camera", 0, xyz, turn) for xyz in (first, moved)]
    lidar = transform("base", "lidar", 0, first, turn)
    messages = [("/tf_static", 1, encode(one)) for one in (camera, [lidar])]
    recording = Recording()
    insert_messages(BufferCore(), [*messages, MESSAGES[1]], SOURCES, recording=recording)
    values = recording.values()
    assert values == [(*first, *turn), (*moved, *turn)]
    records = recording.take()
    assert records["value"][:3].tolist() == [0, 1, 0]
    assert not records["static"][3:].any() and (records["value"][3:] >= len(values)).all()
    assert recording.values() is values


def test_so_many_numbers_of_static_transforms_are_noted():
    moving = [transform("base", "camera", 0, (i, 0, 0)) for i in range(70_000)]
    recording = Recording()
    message = ("/tf_static", 1, encode(moving))
    insert_messages(BufferCore(), [message], SOURCES, recording=recording)
    assert len(recording.values()) == 65_536
    assert len(recording.take()) == 70_000 and recording.lost == 0


def test_a_malformed_message_is_an_error_or_left_out():
    messages = [*MESSAGES[:2], ("/tf", 11, b"nonsense"), *MESSAGES[2:]]
    buffer, found = BufferCore(), []
    with pytest.raises(ValueError, match="malformed TFMessage"):
        insert_messages(buffer, messages, SOURCES)
    assert buffer.frames()["odom"].count == 1
    buffer = BufferCore()
    assert insert_messages(buffer, messages, SOURCES, on_malformed=lambda *what: found.append(what)) == 4
    assert buffer.frames()["odom"].count == 2
    assert [what[:2] for what in found] == [("/tf", 11)]


@pytest.mark.parametrize(
    "how", [{}, {"on_broken": lambda error, last_ns: OSError(f"{error} after {last_ns}")}]
)
def test_an_error_of_the_iteration_is_raised_or_explained(how):
    def broken():
        yield from MESSAGES
        raise OSError("it ends")

    buffer = BufferCore()
    with pytest.raises(OSError, match=f"^it ends{f' after {102 * S}' if how else ''}$"):
        insert_messages(buffer, broken(), SOURCES, **how)
    assert "camera" in buffer, "what came before is kept"
