# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Matrices straight from a buffer: the numbers of the messages, in any array."""

import numpy as np
import pytest
from messages_with_or_without_ros import Duration
from times_and_transforms import S, about_z, at, transform

from tf2_py import (
    BufferCore,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
)

TIMES = np.arange(S, 3 * S, S // 20)
TWO_TIMES = {"fixed_frame": "map", "target_time": at(2.5)}


@pytest.fixture
def buffer():
    """A robot on a spiral, with a turning arm and a lidar: map > odom > base > (arm), (lidar)."""
    buffer = BufferCore(Duration(seconds=100))
    for i in range(26):
        seconds = 1 + i / 10
        for parent, child, xyz, angle in (
            ("map", "odom", (0.01 * i, 0, 0), 0.01 * i),
            ("odom", "base", (np.cos(seconds), np.sin(seconds), 0.1 * i), seconds),
            ("base", "arm", (0, 0, 1), -2 * seconds),
        ):
            buffer.set_transform(transform(parent, child, seconds, xyz, about_z(angle)), "x")
    buffer.set_transform_static(transform("base", "lidar", xyz=(0.5, 0, 1), xyzw=(0.5, 0.5, 0.5, 0.5)), "x")
    return buffer


@pytest.mark.parametrize("count", [0, 1, 2, 63, 64, 65, 129])
def test_any_number_of_times_and_of_frames(buffer, count):
    times = np.linspace(S, 3 * S, count).astype(np.int64)
    matrices = buffer.lookup_matrices("map", "arm", times)
    assert matrices.shape == (count, 4, 4)
    of_frames = buffer.lookup_matrices("map", ["arm", "map", "lidar"], times)
    assert of_frames.shape == (3, count, 4, 4)
    assert np.array_equal(of_frames[0], matrices)
    assert np.array_equal(of_frames[1], np.broadcast_to(np.eye(4), (count, 4, 4)))
    assert buffer.lookup_matrices("map", [], times).shape == (0, count, 4, 4)


# Where the matrix is written to.


class Own(np.ndarray):
    pass


OUTS = {
    "float64": lambda: np.full((4, 4), 7.0),
    "float32": lambda: np.full((4, 4), 7.0, np.float32),
    "float16": lambda: np.full((4, 4), 7.0, np.float16),
    "long double": lambda: np.full((4, 4), 7.0, np.longdouble),
    "other byte order": lambda: np.full((4, 4), 7.0, np.dtype("f8").newbyteorder()),
    "columns first": lambda: np.full((4, 4), 7.0, order="F"),
    "one of many": lambda: np.full((5, 4, 4), 7.0)[2],
    "a part of a larger one": lambda: np.full((8, 9), 7.0)[2:6, 3:7],
    "every other": lambda: np.full((8, 8), 7.0, np.float32)[::2, ::2],
    "backwards": lambda: np.full((4, 4), 7.0)[::-1, ::-1],
    "unaligned": lambda: np.zeros(129, np.uint8)[1:].view(np.float64).reshape(4, 4),
    "a field of a record": lambda: np.zeros((), np.dtype([("a", "u1"), ("m", "f4", (4, 4))]))["m"],
    "a class of its own": lambda: np.full((4, 4), 7.0).view(Own),
}


@pytest.mark.parametrize("make", OUTS.values(), ids=OUTS)
def test_an_array_of_floats_of_any_type_and_layout_receives_it(buffer, make):
    out, expected = make(), buffer.lookup_matrix("lidar", "arm", 2 * S)
    assert buffer.lookup_matrix("lidar", "arm", 2 * S, out) is out
    assert np.array_equal(out, expected.astype(out.dtype))
    assert buffer.lookup_matrix("odom", "odom", 2 * S, out=out) is out
    assert np.array_equal(out, np.eye(4))


def test_nothing_beside_it_is_written(buffer):
    whole = np.full((10, 6, 4), 7.0)
    buffer.lookup_matrix("map", "arm", 2 * S, whole[3, 1:5])
    rest = np.ones(whole.shape, bool)
    rest[3, 1:5] = False
    assert (whole[rest] == 7.0).all()
    assert np.array_equal(whole[3, 1:5], buffer.lookup_matrix("map", "arm", 2 * S))


def test_a_masked_array_is_no_longer_masked(buffer):
    out = np.ma.masked_all((4, 4))
    buffer.lookup_matrix("map", "arm", 2 * S, out)
    assert not np.ma.getmaskarray(out).any()
    assert np.array_equal(out.data, buffer.lookup_matrix("map", "arm", 2 * S))


def read_only():
    array = np.zeros((4, 4))
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    ("out", "kind", "text"),
    [
        ([[0.0] * 4] * 4, TypeError, "out: expected a NumPy array of floats, got list"),
        (Duration(seconds=1), TypeError, "out: expected a NumPy array of floats, got Duration"),
        (memoryview(bytearray(128)), TypeError, "out: expected a NumPy array of floats, got memoryview"),
        (np.zeros((4, 4), int), TypeError, "out: expected an array of floats, got dtype int64"),
        (np.zeros((4, 4), complex), TypeError, "out: expected an array of floats, got dtype complex128"),
        (np.zeros((4, 4), object), TypeError, "out: expected an array of floats, got dtype object"),
        (np.zeros((3, 4)), ValueError, "out: expected the shape (4, 4), got (3, 4)"),
        (np.zeros(16), ValueError, "out: expected the shape (4, 4), got (16,)"),
        (np.zeros((1, 4, 4)), ValueError, "out: expected the shape (4, 4), got (1, 4, 4)"),
        (read_only(), ValueError, "out: expected a writable array, got a read-only one"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_cannot_receive_it_is_refused(buffer, out, kind, text):
    with pytest.raises(kind) as error:
        buffer.lookup_matrix("map", "arm", 2 * S, out)
    assert str(error.value) == text


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_failing_lookup_changes_nothing(buffer, dtype):
    out = np.full((4, 4), 7.0, dtype)
    for target, source, time, error in (
        ("map", "arm", 99 * S, ExtrapolationException),
        ("map", "nowhere", 0, LookupException),
        ("map", "", 0, InvalidArgumentException),
        ("map", "arm", 1.5, TypeError),
    ):
        with pytest.raises(error):
            buffer.lookup_matrix(target, source, time, out)
    assert (out == 7.0).all()


def test_a_fixed_frame_needs_a_target_time(buffer):
    for how in ({"fixed_frame": "map"}, {"target_time": 0}):
        with pytest.raises(TypeError, match="pass both fixed_frame and target_time, or neither"):
            buffer.lookup_matrix("map", "arm", 0, **how)
    with pytest.raises(TypeError, match=r"lookup_matrix\(\) got an unexpected keyword argument 'tolerence'"):
        buffer.lookup_matrix("map", "arm", 0, tolerence=1.0)
    with pytest.raises(TypeError, match=r"lookup_matrices\(\) got an unexpected keyword argument 'out'"):
        buffer.lookup_matrices("map", "arm", [0], out=np.zeros((1, 4, 4)))
