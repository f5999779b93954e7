# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Buffers travel: by pickle and as copies; test_buffer_beside_model.py holds what the copies answer."""

import io
import pickle

import numpy as np
import pytest
from pickles_and_copies import BY_FILE, HISTORIES, WAYS, check_copy, filled
from rclpy.duration import Duration
from times_and_transforms import S, at, transform, translation

from tf2_py import BufferCore
from tf2_ros import Buffer, TransformListener

pytestmark = pytest.mark.usefixtures("no_refusals_logged")


@pytest.fixture
def buffer():
    return filled(BufferCore(Duration(seconds=20), max_frames=20, max_bytes=50_000))


@pytest.fixture(params=WAYS)
def travel(request, tmp_path):
    return lambda buffer: WAYS[request.param](buffer, tmp_path)


@pytest.mark.parametrize("history", HISTORIES)
def test_a_copy_holds_what_the_buffer_holds(history, travel):
    for limits in ({}, {"max_frames": 7}, {"max_bytes": 5_000}):
        buffer = BufferCore(Duration(seconds=20), **limits)
        for i, (parent, child, seconds) in enumerate(HISTORIES[history]):
            buffer.set_transform(transform(parent, child, seconds, (i, 0, 0)), "x")
        check_copy(travel(filled(buffer)), buffer)
        assert bool(limits) == any(
            buffer.statistics()["refused"][f"too_many_{kind}"] for kind in ("frames", "bytes")
        )


def test_a_buffer_made_by_new_alone_arrives(travel):
    for kind in (BufferCore, Buffer):
        arrived = travel(kind.__new__(kind))
        assert type(arrived) is kind
        arrived.set_transform(transform("a", "b", 1), "x")
        assert "b" in arrived


def large():
    """A buffer whose pickle has several parts, because of its frames and because of its samples."""
    frames, samples = 2500, 40_000
    counts = [samples, *[1] * (frames - 1)]
    stamps_ns = [np.arange(count) for count in counts]
    transforms = np.zeros((sum(counts), 7))
    transforms[:, 0], transforms[:, 6] = np.arange(sum(counts)), 1
    buffer = BufferCore()
    buffer.__setstate__(
        buffer.__getstate__()
        | {
            "frames": [(f"frame {i}", False, f"by {i % 3}", count) for i, count in enumerate(counts)],
            "stamps": np.concatenate(stamps_ns),
            "transforms": transforms,
            "parents": np.arange(sum(counts), dtype=np.uint32) % 2000,
            "parent_names": [f"parent {i}" for i in range(2000)],
        }
    )
    return buffer


def test_a_large_buffer_travels(travel):
    buffer = large()
    check_copy(travel(buffer), buffer)


# What a program's own classes add.


class Robot(Buffer):
    """With another constructor, attributes, and a state of its own."""

    def __init__(self, name, *, size):
        super().__init__()
        self.name, self.size, self.itself = name, [size], self

    def __getstate__(self):
        return super().__getstate__() | {"told": 7}

    def __setstate__(self, state):
        self.told = state.pop("told", None)  # a frozen file has none
        super().__setstate__(state)


def test_attributes_and_state_of_a_subclass_travel_and_its_init_is_not_called(buffer, tmp_path):
    robot = Robot("r1", size=3)
    robot.set_transform(transform("map", "odom", 1, (1, 2, 3)), "x")
    for name, travel in WAYS.items():
        arrived = travel(robot, tmp_path)
        assert type(arrived) is Robot
        assert translation(arrived.lookup_transform("map", "odom", at(1))) == (1, 2, 3)
        if name in BY_FILE:
            assert not hasattr(arrived, "name")
            continue
        assert (arrived.name, arrived.size, arrived.told) == ("r1", [3], 7)
        assert arrived.itself is (robot if name == "copy" else arrived)
        assert (arrived.size is robot.size) == (name == "copy")


def test_a_node_does_not_travel(node, tmp_path):
    buffer = Buffer(node=node)
    buffer.name = "r1"
    listener = TransformListener(buffer, node)
    buffer.set_transform(transform("map", "odom", 1), "x")
    for name, travel in WAYS.items():
        arrived = travel(buffer, tmp_path)
        assert hasattr(arrived, "name") == (name not in BY_FILE)
        assert arrived.srv is None and arrived.clock is not buffer.clock
        assert arrived.can_transform("map", "odom", at(1), timeout=0.001)
        assert not arrived.can_transform("map", "odom", at(9), timeout=0.001)
        assert arrived.wait_for_transform_async("map", "odom", at(1)).done()
    listener.unregister()


# What a pickle is.


class NotesNames(pickle.Unpickler):
    """Notes the module of every callable and class that a pickle names."""

    def __init__(self, data):
        super().__init__(io.BytesIO(data))
        self.modules = set()

    def find_class(self, module, name):
        self.modules.add(module.partition(".")[0])
        return super().find_class(module, name)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_pickles_name_only_our_own_and_numpys_callables(protocol):
    unpickler = NotesNames(pickle.dumps(filled(Buffer()), protocol))
    unpickler.load()
    # Python itself writes bytes by a codec, where its protocol has none.
    assert unpickler.modules == {"numpy", "tf2_py", "tf2_ros"} | ({"_codecs"} if protocol < 3 else set())


def test_arrays_are_not_copied_into_a_pickle_of_protocol_5():
    buffer = BufferCore(Duration(seconds=10_000))
    for i in range(1000):
        buffer.set_transform(transform("map", "odom", i), "x")
    buffers = []
    data = pickle.dumps(buffer, 5, buffer_callback=buffers.append)
    assert len(data) < 1500
    assert sum(len(one.raw()) for one in buffers) >= 1000 * (8 + 56 + 4)
    # Read-only memory is as good.
    arrived = pickle.loads(data, buffers=[one.raw().toreadonly() for one in buffers])
    assert arrived.frames() == buffer.frames()


def test_arrays_in_another_order_of_bytes_or_memory_are_converted(buffer):
    state = buffer.__getstate__()
    for key in ("stamps", "transforms", "parents"):
        state[key] = np.asfortranarray(state[key].astype(state[key].dtype.newbyteorder()))
    arrived = BufferCore()
    arrived.__setstate__(state)
    check_copy(arrived, buffer)


# What is refused.


def frames_of(**changes):
    """The frames of a state, the first one changed."""

    def change(frames):
        names = ("name", "is_static", "authority", "count")
        return [tuple((dict(zip(names, frames[0], strict=True)) | changes).values()), *frames[1:]]

    return "frames", change


def put(key, index, value):
    def change(array):
        array[index] = value
        return array

    return key, change


SPOILED = {
    "lacks cache_time_ns": ("cache_time_ns", None),
    "cache_time_ns: expected an int from 0 to .*, got -1": ("cache_time_ns", lambda _: -1),
    "max_frames: expected an int from 1 to .*, got 'all'": ("max_frames", lambda _: "all"),
    "max_bytes: expected an int from 1 to": ("max_bytes", lambda _: 1 << 200),
    "a frame name must not contain a NUL": frames_of(name="a\0b"),
    "frame name: expected a str": ("parent_names", lambda names: [None] * len(names)),
    "odom is refused: .*are the same": ("parent_names", lambda names: ["odom"] * len(names)),
    ' is refused: .*"NO_PARENT" is reserved': frames_of(name="NO_PARENT"),
    "child_frame_id is not set": frames_of(name=""),
    "frame_id is not set": put("parents", 0, 0xFFFFFFFF),
    "authority: expected a str": frames_of(authority=None),
    "does not contain -1 samples": frames_of(count=-1),
    "does not contain 1000 samples": frames_of(count=1000),
    "does not contain 1.0 samples": frames_of(count=1.0),
    "contain 11 samples, but its frames list 10": frames_of(count=5),
    "need more than 2 values": ("frames", lambda frames: [frames[0][:2]]),
    "of one length, got 11 stamps, 11 transforms and 10 parents": ("parents", lambda array: array[1:]),
    "unexpected dtype or shape": ("transforms", lambda array: array[:, :6]),
    "the stamp is negative": put("stamps", 0, -1),
    "the stamp does not fit": put("stamps", 5, 2**31 * S),
    "a number is NaN": put("transforms", (0, 0), np.nan),
    "the translation is infinite": put("transforms", (3, 2), -np.inf),
    "it cannot have these attributes": ("attributes", lambda _: {"color": "red"}),
    "cannot have these attributes": ("attributes", lambda _: 5),
    "has no attribute|not iterable|has no len": ("frames", lambda _: None),
    "not contain 1180591620717411303424 samples": frames_of(count=2**70),
    "the rotation is too short": put("transforms", (-1, slice(3, 7)), 0.0),
}


@pytest.mark.parametrize("why", SPOILED)
def test_a_spoiled_state_is_refused_and_changes_nothing(why, buffer):
    key, change = SPOILED[why]
    state = buffer.__getstate__()
    value = state.pop(key, None)
    if change is not None:
        state[key] = change(value)
    arriving = filled(BufferCore())
    with pytest.raises(ValueError, match=why):
        arriving.__setstate__(state)
    check_copy(arriving, filled(BufferCore()))
