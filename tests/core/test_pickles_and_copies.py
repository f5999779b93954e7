# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Buffers travel: by pickle and as copies; test_buffer_beside_model.py holds what the copies answer."""

import io
import pickle

import numpy as np
import pytest
from pickles_and_copies import BY_FILE, HISTORIES, WAYS, check_copy, filled
from rclpy.duration import Duration
from times_and_transforms import at, transform, translation

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


@pytest.mark.parametrize("samples", [1, 8, 70, 91])
def test_a_copy_has_room_for_as_many_samples_as_its_buffer(samples):
    def of_samples(**limits):
        buffer = BufferCore(Duration(seconds=20), **limits)
        buffer.set_transforms([transform("map", "base", ns=i) for i in range(1, 1 + samples)], "x")
        return buffer

    buffer = of_samples(max_bytes=of_samples().statistics()["bytes"])
    copied = pickle.loads(pickle.dumps(buffer))
    later = [transform("map", "base", ns=1000 + i) for i in range(100)]
    assert copied.set_transforms(later, "x") == buffer.set_transforms(later, "x") == 100
    assert copied.histories()["base"].stamps_ns.tolist() == buffer.histories()["base"].stamps_ns.tolist()
    assert buffer.statistics()["samples"] < samples + 100


def test_a_buffer_made_by_new_alone_arrives(travel):
    for kind in (BufferCore, Buffer):
        arrived = travel(kind.__new__(kind))
        assert type(arrived) is kind
        arrived.set_transform(transform("a", "b", 1), "x")
        assert "b" in arrived


def large():
    """A buffer of many frames, one of them with many samples, so that a frozen file is written in pieces."""
    frames = [0] * 40_000 + [*range(1, 2500)]
    links = (
        transform(f"parent {i % 2000}", f"frame {frame}", ns=i, xyz=(i, 0, 0))
        for i, frame in enumerate(frames)
    )
    buffer = BufferCore()
    buffer.set_transforms(links, "x")
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


def test_samples_are_not_copied_into_a_pickle_of_protocol_5():
    buffer = BufferCore(Duration(seconds=10_000))
    for i in range(1000):
        buffer.set_transform(transform("map", "odom", i), "x")
    buffers = []
    data = pickle.dumps(buffer, 5, buffer_callback=buffers.append)
    assert len(data) < 500
    [image] = buffers
    assert len(image.raw()) >= 1000 * (8 + 64)
    for kind in (bytes, bytearray, memoryview, pickle.PickleBuffer):
        check_copy(pickle.loads(data, buffers=[kind(image.raw())]), buffer)


# What is refused; test_frozen.py has images with wrong numbers.

SPOILED = {
    "not the state of a buffer: a bytes-like object is required": ("image", lambda _: None),
    "not the state of a buffer: a bytes-like object is required ": ("image", lambda image: image.tolist()),
    "not the state of a buffer: .*not C-contiguous": ("image", lambda image: memoryview(image)[::2]),
    "or another version of tf2-ros-cython wrote it": ("image", lambda image: image[:64]),
    "or another version of tf2-ros-cython wrote it ": ("image", lambda image: np.roll(image, 8)),
    "the state of the buffer is damaged": ("image", lambda image: image[:-64]),
    "it cannot have these attributes": ("attributes", lambda _: {"color": "red"}),
    "cannot have these attributes": ("attributes", lambda _: 5),
}


@pytest.mark.parametrize("why", SPOILED)
def test_a_spoiled_state_is_refused_and_changes_nothing(why, buffer):
    key, change = SPOILED[why]
    state = buffer.__getstate__()
    state[key] = change(state[key])
    arriving = filled(BufferCore())
    with pytest.raises(ValueError, match=why.rstrip()):
        arriving.__setstate__(state)
    check_copy(arriving, filled(BufferCore()))
