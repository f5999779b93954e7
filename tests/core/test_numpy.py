# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages as matrices, arrays and the columns of data frames."""

import math
import re
from functools import partial

import numpy as np
import pytest
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    Transform,
    TransformStamped,
    Twist,
)
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from processes import output_of
from random_messages import transforms, turns, vectors
from rotations import Turn
from textbook_transforms import matrix
from times_and_transforms import S, transform, translation

from tf2_ros.numpy import from_matrix, to_arrays, to_columns, to_matrix


def pose_of(t):
    position = Point(**dict(zip("xyz", translation(t), strict=True)))
    return Pose(position=position, orientation=t.transform.rotation)


@given(transforms)
def test_a_matrix_is_that_of_the_textbook(t):
    got = to_matrix(t)
    assert got.dtype == np.float64 and got.shape == (4, 4)
    assert_allclose(got, matrix(t), rtol=1e-12, atol=1e-12)
    for same in (t.transform, pose_of(t), PoseStamped(pose=pose_of(t))):
        assert np.array_equal(to_matrix(same), got)
    # In float32 it is the same rounded, also of many of which one is missing.
    translations, rotations = to_arrays([t, t, t])
    translations[1], rotations[1] = np.nan, np.nan
    for one in (t, (translations, rotations)):
        rounded = to_matrix(one, dtype=np.float32)
        assert rounded.dtype == np.float32 and rounded.flags.c_contiguous
        np.testing.assert_array_equal(rounded, to_matrix(one).astype(np.float32))


def test_a_rounded_matrix_is_refused_with_the_remedy():
    m = to_matrix(transform("map", "base", 1, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))).round(4)
    for wrong in (m.copy(), np.stack([m, m])):
        with pytest.raises(ValueError, match="must be orthogonal.* If its numbers are rounded: ") as caught:
            from_matrix(wrong) if wrong.ndim == 2 else to_arrays(wrong)
        exec(str(caught.value).partition("rounded: ")[2], {"numpy": np, "m": wrong})
        assert_allclose(to_matrix(to_arrays(wrong)), np.broadcast_to(m, wrong.shape), atol=1e-4)


@given(transforms, st.sampled_from([Transform, TransformStamped, Pose, PoseStamped]))
def test_a_matrix_becomes_a_message_of_the_class_asked_for(t, cls):
    got = from_matrix(to_matrix(t), cls)
    assert type(got) is cls
    assert_allclose(to_matrix(got), to_matrix(t), atol=1e-12)
    q = to_arrays([got])[1][0]
    assert math.isclose(np.linalg.norm(q), 1) and q[3] >= 0
    assert from_matrix(to_matrix(t)) == from_matrix(to_matrix(t), Transform)


def test_a_matrix_that_was_rounded_to_float32_is_near_enough():
    m = np.eye(4, dtype=np.float32)
    for angle in range(100):
        m[:3, :3] = m[:3, :3] @ Turn.from_angles(angle, 1, 2).as_matrix().astype(np.float32)
    assert_allclose(to_matrix(from_matrix(m)), m, atol=1e-5)


@given(vectors, turns)
def test_arrays_hold_translations_and_rotations_row_by_row(v, q):
    messages = [transform("map", "base", 0, v, q), Transform(), pose_of(transform("a", "b", 0, v, q))]
    translations, rotations = to_arrays(iter(messages))
    assert translations.dtype == rotations.dtype == np.float64
    assert translations.shape == (3, 3) and rotations.shape == (3, 4)
    assert np.array_equal(translations, [v, (0, 0, 0), v])
    unit = np.array(q) / np.linalg.norm(q)
    assert_allclose(rotations, [unit, (0, 0, 0, 1), unit], atol=1e-15)
    assert_allclose(Turn(rotations).as_matrix()[0], to_matrix(messages[0])[:3, :3], atol=1e-12)


def test_what_is_masked_is_missing():
    matrices = np.ma.masked_array(np.stack([np.eye(4)] * 2), mask=False)
    matrices[1] = np.ma.masked
    _, rotations = to_arrays(matrices)
    assert rotations[0].tolist() == [0, 0, 0, 1] and np.isnan(rotations[1]).all()
    rotations = np.ma.masked_array([[0, 0, 0, 1], [0, 0, 0, 1]], [[False] * 4, [True] * 4])
    assert np.isnan(to_matrix((np.zeros((2, 3)), rotations))).any(axis=(1, 2)).tolist() == [False, True]
    with pytest.raises(ValueError, match="expected finite numbers and the last row 0 0 0 1, got "):
        from_matrix(np.ma.masked_array(np.eye(4), mask=np.eye(4)))


def header():
    return transform("map", "base", 7.25).header


@pytest.mark.parametrize("cls", [TransformStamped, PoseStamped])
def test_a_message_has_a_copy_of_the_header_and_the_child_frame(cls):
    given = header()
    got = from_matrix(np.eye(4), cls, header=given)
    given.stamp.sec, given.frame_id = 99, "other"
    assert got.header == header()
    made = from_matrix(np.eye(4), header=header(), child_frame_id="base")
    assert made == transform("map", "base", 7.25)


pairs = st.lists(st.tuples(vectors, turns), max_size=5).map(
    lambda rows: (
        np.array([v for v, _ in rows]).reshape(-1, 3),
        np.array([q for _, q in rows]).reshape(-1, 4),
    )
)


class TestManyMatrices:
    @given(pairs)
    def test_each_is_that_of_its_row(self, pair):
        got = to_matrix(pair)
        assert got.dtype == np.float64 and got.shape == (len(pair[0]), 4, 4)
        for one, v, q in zip(got, *pair, strict=True):
            assert np.array_equal(one, to_matrix(transform("map", "base", 0, v, q)))
        # Any shape may stand before.
        assert np.array_equal(to_matrix(tuple(part[None, :, None] for part in pair)), got[None, :, None])
        kept = got.copy()
        for part in to_arrays(got):
            part[:] = 7  # it is the caller's own
        assert np.array_equal(got, kept)

    @given(pairs)
    def test_they_become_the_arrays_they_came_from(self, pair):
        matrices = np.concatenate([to_matrix(pair), np.full((1, 4, 4), math.nan)])
        translations, rotations = to_arrays(matrices)
        assert translations.dtype == rotations.dtype == np.float64
        assert np.isnan(translations[-1]).all() and np.isnan(rotations[-1]).all()  # what is missing stays so
        translations, rotations = translations[:-1], rotations[:-1]
        assert np.array_equal(translations, pair[0])
        assert rotations.shape == pair[1].shape and (rotations[:, 3] >= 0).all()
        units = pair[1] / np.linalg.norm(pair[1], axis=1, keepdims=True)
        assert_allclose(np.abs((rotations * units).sum(axis=1)), 1, rtol=0, atol=2e-15)
        assert_allclose(to_matrix((translations, rotations)), to_matrix(pair), rtol=0, atol=4e-15)

    @pytest.mark.parametrize("axis", np.vstack([np.eye(3), [[1, 1, 1], [-1, 2, 0.001], [0, -1e-9, 1]]]))
    def test_turns_near_180_degrees_lose_nothing(self, axis):
        axis = axis / np.linalg.norm(axis)
        angles = math.pi + np.array([0, 1e-16, 1e-12, -1e-12, 1e-8, -1e-8, 1e-4, -1e-4])
        turns = Turn.from_vector(angles[:, None] * axis)
        _, rotations = to_arrays(to_matrix((np.zeros((8, 3)), turns.q)))
        # The scalar product of two quaternions, but more exactly: the angle between them.
        between = (turns.inverse() * Turn(rotations)).angle()
        assert between.max() < 1e-15


def test_pandas_is_not_imported():
    assert output_of("-c", "import sys, tf2_ros.numpy; print('pandas' in sys.modules)") == "False\n"


class TestDataFrames:
    def test_the_columns_hold_times_translations_and_rotations(self):
        translations = np.arange(9.0).reshape(3, 3)
        rotations = np.array([(0.0, 0.0, 0.0, 2.0), (0.5, -0.5, 0.5, -0.5), (math.nan,) * 4])
        translations[2] = math.nan
        got = to_columns((translations, rotations), [S, 2 * S, 3 * S])
        assert list(got) == ["stamp_ns", "x", "y", "z", "qx", "qy", "qz", "qw"]
        assert [column.dtype for column in got.values()] == [np.int64] + [np.float64] * 7
        assert got["stamp_ns"].tolist() == [S, 2 * S, 3 * S]
        rows = np.array([*got.values()][1:]).T
        assert rows[:2].tolist() == [[0, 1, 2, 0, 0, 0, 1], [3, 4, 5, 0.5, -0.5, 0.5, -0.5]]
        assert np.isnan(rows[2]).all()

    @pytest.mark.long("needs pandas")
    def test_pandas_takes_the_columns(self):
        pandas = pytest.importorskip("pandas")
        translations = np.array([(1.0, 2.0, 3.0), (math.nan,) * 3])
        rotations = np.array([(0.0, 0.0, 0.0, 1.0), (math.nan,) * 4])
        frame = pandas.DataFrame(to_columns((translations, rotations), [S, 2 * S]))
        assert frame.shape == (2, 8) and len(frame.dropna()) == 1
        assert pandas.to_datetime(frame.stamp_ns)[1] == pandas.Timestamp(2 * S)

    def test_stamped_messages_have_times_of_their_own(self):
        t = transform("map", "base", 7.25, (1, 2, 3), (0.5, 0.5, 0.5, 0.5))
        # A tuple of two messages is no pair of arrays.
        for messages in (iter([t, PoseStamped(header=t.header, pose=pose_of(t))]), (t, t)):
            got = to_columns(messages)
            assert got["stamp_ns"].tolist() == [7_250_000_000] * 2
            assert got["y"].tolist() == [2, 2] and got["qw"].tolist() == [0.5, 0.5]

    def test_times_may_be_datetime64(self):
        pair = [[0, 0, 0]], [[0, 0, 0, 1]]
        assert to_columns(pair, np.array(["1970-01-01T00:00:02"], "M8[s]"))["stamp_ns"].tolist() == [2 * S]


# What is refused.

EYE, ONE = np.eye(4), transform("map", "base", 1, (1, 2, 3))
SHORT = transform("map", "base", xyzw=(0, 0, 0, 0))
NO_MESSAGE = "expected a TransformStamped, Transform, PoseStamped or Pose"


def rotated(*wrong):
    """Pairs of shape (2, 3), the last with this rotation, the first missing."""
    rotations = np.tile([0.0, 0.0, 0.0, 1.0], (2, 3, 1))
    rotations[1, 2], rotations[0, 0] = wrong, math.nan
    return np.zeros((2, 3, 3)), rotations


def fourth(*diagonal):
    """Four matrices, one of them missing; the last has this diagonal."""
    return np.stack([EYE, np.full((4, 4), math.nan), EYE, np.diag(diagonal)])


PAIR = np.zeros((1, 3)), np.ones((1, 4))
# What the error is, and the calls that raise it.
REFUSED = {
    r"TypeError: dtype: expected numpy\.float64 or": [
        partial(to_matrix, ONE, dtype=dtype) for dtype in (np.float16, ">f4")
    ],
    f"TypeError: {NO_MESSAGE}": [
        *[partial(to_matrix, wrong) for wrong in (None, "text", Twist(), [Transform()])],
        *[partial(to_arrays, [wrong]) for wrong in (None, "text", Twist(), [Transform()])],
    ],
    # Of another message only the type is named.
    "TypeError: .*Pose, got Twist$": [partial(to_matrix, Twist())],
    "TypeError: .*got ndarray$": [partial(to_matrix, EYE)],
    r"TypeError: .*\(translations, rotations\), got a tuple of [01]": [
        partial(to_matrix, wrong) for wrong in ((), (np.zeros((2, 3)),))
    ],
    r"ValueError: .*shapes \(N, 3\) and \(N, 4\), got \(": [
        partial(to_matrix, (np.ones(v), np.ones(q)))
        for v, q in (((2, 3), (3, 4)), ((2, 4), (2, 3)), ((2, 3), (4,)), ((3,), (2, 4)), ((), ()))
    ],
    r"ValueError: rotations\[1, 2\] must have a finite, non-zero length, got \[": [
        partial(to_matrix, rotated(*wrong))
        for wrong in ((0, 0, 0, 0), (math.nan, 0, 0, 1), (0, math.inf, 0, 0))
    ],
    r"ValueError: the rotation must have a finite, non-zero length, got \[0.0, 0": [
        partial(to_matrix, (np.zeros(3), np.zeros(4)))
    ],
    "ValueError: .*rotation of message 0": [partial(to_matrix, SHORT)],
    "ValueError: .*rotation of message 1": [partial(to_arrays, [Transform(), SHORT])],
    r"ValueError: matrices\[3\]: .*R R.T differs from the identity by 3$": [
        partial(to_arrays, fourth(2, 2, 2, 1))
    ],
    r"ValueError: matrices\[3\]: .*differs from the identity by 0.0002": [
        partial(to_arrays, fourth(1, 1, 1 + 1e-4, 1))
    ],
    r"ValueError: matrices\[3\]: .*reflection": [partial(to_arrays, fourth(1, 1, -1, 1))],
    r"ValueError: matrices\[3\]: .*last row": [partial(to_arrays, fourth(1, 1, 1, 2))],
    r"ValueError: matrices\[3\]: .*finite": [partial(to_arrays, fourth(1, 1, 1, math.nan))],
    r"ValueError: .*shape \(4, 4\)": [
        partial(to_arrays, np.zeros(shape)) for shape in ((4,), (0,), (3, 4), (4, 4, 3))
    ],
    "(Type|Value)Error: matrix: expected": [partial(from_matrix, wrong) for wrong in (None, [["a"] * 4] * 4)],
    "TypeError: .*numbers: complex numbers are not supported$": [
        partial(call, EYE * 1j) for call in (from_matrix, to_arrays)
    ],
    r"ValueError: .*got \(3, 4, 4\); to_arrays takes many": [partial(from_matrix, np.stack([EYE] * 3))],
    "TypeError: .*has no header": [
        partial(from_matrix, EYE, *cls, header=header()) for cls in ([], [Transform], [Pose])
    ],
    "TypeError: .*(Transform|Pose|PoseStamped) has no child_": [
        partial(from_matrix, EYE, cls, child_frame_id="b") for cls in (Transform, Pose, PoseStamped)
    ],
    "AttributeError: 'Transform' object has no attribute 'header'": [partial(to_columns, [Transform()])],
    "TypeError: .*pass times": [partial(to_columns, PAIR)],
    "TypeError: .*omit times": [partial(to_columns, [ONE], [1]), partial(to_columns, (ONE, ONE), [1, 2])],
    "ValueError: .*got 2 times and rotations of shape": [
        partial(to_columns, pair, [1, 2]) for pair in (PAIR, (np.zeros(3), np.ones(4)))
    ],
}


@pytest.mark.parametrize("error", REFUSED)
def test_what_is_refused_is_named(error):
    for call in REFUSED[error]:
        with pytest.raises((TypeError, ValueError, AttributeError)) as raised:
            call()
        assert re.match(error, f"{raised.type.__name__}: {raised.value}"), raised.value
