# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Serialized TFMessages that a buffer reads; the fuzz target `cdr` judges reading by ROS."""

import struct
import threading

import numpy as np
import pytest
from cdr_encoder import encode
from rclpy.serialization import deserialize_message, serialize_message
from times_and_transforms import at, transform

from tf2_msgs.msg import TFMessage
from tf2_py._tf2_py import serialize_as_ros
from tf2_ros.serialization import serialize_transforms


@pytest.fixture
def buffer(tf2_py):
    return tf2_py.BufferCore()


GOOD = encode(
    [
        transform("map", "odom", 1.25, (1, 2, 3)),
        transform("λ-frame", "", 1, (4, 5, 6)),  # refused, but well-formed
        transform("odom", "base_link", 1.25, (-1e300, 1e-300, 0.1), (0.5, -0.5, 0.5, 0.5)),
    ]
)
AT_COUNT, AT_NAME = 4, 16  # byte offsets of the count and of the first frame_id's length

MALFORMED = {
    "another representation": b"\0\7" + GOOD[2:],
    "parameter list": b"\0\3" + GOOD[2:],
    "a huge count": GOOD[:AT_COUNT] + b"\xff\xff\xff\xff" + GOOD[8:],
    "a count above what is there": GOOD[:AT_COUNT] + struct.pack("<I", 4) + GOOD[8:],
    "a count below what is there": GOOD[:AT_COUNT] + struct.pack("<I", 2) + GOOD[8:],
    "a huge string": GOOD[:AT_NAME] + b"\xff\xff\xff\xff" + GOOD[AT_NAME + 4 :],
    "a string without its NUL": GOOD.replace(b"map\0", b"maps"),
    "no UTF-8": GOOD.replace(b"map\0", b"m\xffp\0"),
    "an overlong UTF-8 form": GOOD.replace(b"map\0", b"\xc0\xafp\0"),
    "a surrogate in UTF-8": GOOD.replace(b"map\0", b"\xed\xa0\x80\0"),
    "bytes behind the end": GOOD + b"\0",
    **{f"the first {size} bytes": GOOD[:size] for size in range(len(GOOD))},
}


@pytest.mark.parametrize("data", MALFORMED.values(), ids=MALFORMED)
def test_malformed_data_raises_and_changes_nothing(buffer, data):
    with pytest.raises(ValueError, match="malformed TFMessage: .* at byte"):
        buffer.set_transforms_cdr(data, "x")
    statistics = buffer.statistics()
    assert (statistics["frames"], statistics["samples"], statistics["malformed_messages"]) == (0, 0, 1)


@pytest.mark.parametrize("order", "><")
def test_no_other_representation_than_plain_cdr_is_read(buffer, order):
    """Whatever its second byte, the bytes that follow are in the order that an odd one names."""
    empty = struct.pack(f"{order}I", 0)
    for number in range(512):
        data = struct.pack(">HH", number, 0) + empty
        if number < 2:
            assert buffer.set_transforms_cdr(data, "x") == 0
        else:
            with pytest.raises(ValueError, match="the encapsulation header is not plain CDR, at byte 0 of 8"):
                buffer.set_transforms_cdr(data, "x")


def test_a_name_ends_at_a_nul_whatever_follows(buffer):
    for inside in (b"m\0p\0", b"m\0\xff\0", b"m\0\0\0"):
        buffer.set_transforms_cdr(GOOD.replace(b"map\0", inside), "x")
    assert "m" in buffer and "map" not in buffer
    assert buffer.statistics()["malformed_messages"] == 0
    buffer.set_transforms_cdr(GOOD.replace(b"map\0", b"\0ap\0"), "x")
    assert buffer.statistics()["refused"]["no_frame_id"] > 0


def test_a_name_of_a_message_ends_at_a_nul_as_if_it_had_been_sent(buffer):
    odd = transform("map\0s", "odom\0\xe9", 1)
    cut = transform("map", "odom", 1)
    assert deserialize_message(serialize_message(TFMessage(transforms=[odd])), TFMessage).transforms == [cut]
    assert serialize_as_ros([odd]) == serialize_as_ros([cut]) and serialize_transforms(odd) == encode([cut])
    for insert in (buffer.set_transform, buffer.set_transform_static):
        insert(odd, "x")
    buffer.set_transforms([odd, transform("odom\0", "arm\0m", 1)], "x")
    assert buffer._getFrameStrings() == ["odom", "map", "arm"]
    buffer.set_transform(transform("map", "\0odom", 1), "x")
    assert buffer.statistics()["refused"]["no_child_frame_id"] == 1
    for call in (
        lambda: buffer.lookup_transform_core("map", "odom\0", at(1)),
        lambda: buffer.forget("odom\0"),
        lambda: buffer.set_transform(cut, "x\0"),
    ):
        with pytest.raises(ValueError, match="NUL"):
            call()


def test_what_is_not_one_run_of_bytes_is_refused(buffer):
    for data in (None, "text", 3, [1, 2]):
        with pytest.raises(TypeError):
            buffer.set_transforms_cdr(data, "x")
    with pytest.raises(BufferError, match="not C-contiguous"):
        buffer.set_transforms_cdr(memoryview(bytes(16))[::2], "x")


@pytest.mark.parametrize("wrap", [bytearray, lambda data: np.frombuffer(data, np.uint8).copy()])
def test_what_another_thread_does_to_the_bytes_meanwhile_changes_nothing(buffer, wrap):
    # So many that it can run while they are inserted.
    data = wrap(encode([transform(f"parent{i:06}", f"child{i:06}", 1) for i in range(20_000)]))
    spoiled = bytes([255]) * len(data)
    over = threading.Event()

    def spoil():
        while not buffer.statistics()["taken"] and not over.is_set():
            pass
        memoryview(data)[:] = spoiled

    thread = threading.Thread(target=spoil)
    thread.start()
    try:
        assert buffer.set_transforms_cdr(data, "x") == 20_000
    finally:
        over.set()
        thread.join()
    buffer._self_check()
    assert len(buffer.frames()) == 40_000
