"""Messages as matrices, arrays, rotations of SciPy and data frames, judged by SciPy."""

import importlib.abc
import math
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from expected import matrix, turn, xyz, xyzw
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    QuaternionStamped,
    Transform,
    TransformStamped,
    Twist,
)
from hypothesis import given
from hypothesis import strategies as st
from making import S, rotation, transform, translation
from numpy.testing import assert_allclose
from random_messages import transforms, turns, vectors
from scipy.spatial.transform import Rotation

from tf2_ros.numpy import from_matrix, from_rotation, to_arrays, to_columns, to_matrix, to_rotation

pytestmark = pytest.mark.ours


def pose_of(t):
    position = Point(**dict(zip("xyz", translation(t), strict=True)))
    return Pose(position=position, orientation=t.transform.rotation)


@given(transforms)
def test_a_matrix_is_what_scipy_makes(t):
    got = to_matrix(t)
    assert got.dtype == np.float64 and got.shape == (4, 4)
    assert_allclose(got, matrix(t), rtol=1e-12, atol=1e-12)
    for same in (t.transform, pose_of(t), PoseStamped(pose=pose_of(t))):
        assert np.array_equal(to_matrix(same), got)


@given(transforms)
def test_a_matrix_becomes_the_message_it_came_from(t):
    got = from_matrix(to_matrix(t))
    assert type(got) is Transform
    assert_allclose(xyz(got.translation), translation(t))
    assert_allclose(turn(got.rotation).as_matrix(), turn(t.transform.rotation).as_matrix(), atol=1e-12)
    assert math.isclose(np.linalg.norm(xyzw(got.rotation)), 1) and got.rotation.w >= 0


@given(transforms)
def test_a_matrix_of_float32_is_the_other_one_rounded(t):
    translations, rotations = to_arrays([t, t, t])
    translations[1], rotations[1] = np.nan, np.nan
    for one in (t, (translations, rotations)):
        got = to_matrix(one, dtype=np.float32)
        assert got.dtype == np.float32 and got.flags.c_contiguous
        np.testing.assert_array_equal(got, to_matrix(one).astype(np.float32))


@pytest.mark.parametrize("dtype", [np.float16, np.int64, ">f4", complex, object])
def test_a_matrix_has_no_other_dtype(dtype):
    with pytest.raises(TypeError, match=r"dtype: expected numpy\.float64 or numpy\.float32, got"):
        to_matrix(Transform(), dtype=dtype)


@pytest.mark.parametrize("axis", range(3))
def test_of_a_half_turn_the_greatest_part_is_positive(axis):
    m = -np.eye(4)
    m[axis, axis] = m[3, 3] = 1.0
    assert xyzw(from_matrix(m).rotation).tolist() == np.eye(4)[axis].tolist()


@pytest.mark.parametrize("cls", [Transform, TransformStamped, Pose, PoseStamped])
def test_a_matrix_becomes_the_class_asked_for(cls):
    m = to_matrix(transform("map", "base", 0, (1, 2, 3), (0.5, 0.5, 0.5, 0.5)))
    got = from_matrix(m, cls)
    assert type(got) is cls
    assert_allclose(to_matrix(got), m, atol=1e-15)


@pytest.mark.parametrize("wrong", [None, "matrix", [["a"] * 4] * 4, {}])
def test_a_matrix_of_no_numbers_is_refused(wrong):
    with pytest.raises((TypeError, ValueError), match="matrix: expected"):
        from_matrix(wrong)


def test_a_matrix_that_was_rounded_to_float32_is_near_enough():
    m = np.eye(4, dtype=np.float32)
    for angle in range(100):
        m[:3, :3] = m[:3, :3] @ Rotation.from_euler("xyz", [angle, 1, 2]).as_matrix().astype(np.float32)
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
    scipy = Rotation.from_quat(rotations)
    assert_allclose(scipy[0].as_matrix(), to_matrix(messages[0])[:3, :3], atol=1e-12)


def test_arrays_of_nothing_have_their_shapes():
    translations, rotations = to_arrays([])
    assert translations.shape == (0, 3) and rotations.shape == (0, 4)


@pytest.mark.parametrize("q", [(0, 0, 0, 0), (math.nan, 0, 0, 1), (0, math.inf, 0, 0)])
def test_a_rotation_without_length_is_a_value_error(q):
    t = transform("map", "base", 0, xyzw=q)
    with pytest.raises(ValueError, match="rotation of message 0"):
        to_matrix(t)
    with pytest.raises(ValueError, match="rotation of message 1"):
        to_arrays([Transform(), t])


@pytest.mark.parametrize("wrong", [None, 5, "text", Twist(), [Transform()]], ids=lambda w: type(w).__name__)
def test_another_message_is_a_type_error(wrong):
    with pytest.raises(TypeError, match="expected a TransformStamped, Transform, PoseStamped or Pose"):
        to_matrix(wrong)
    with pytest.raises(TypeError, match="expected a TransformStamped, Transform, PoseStamped or Pose"):
        to_arrays([wrong])


def test_many_messages_have_no_single_matrix():
    for many in ([Pose()], np.array([Pose(), Pose()]), np.eye(4), (Pose() for _ in range(2))):
        with pytest.raises(TypeError, match=rf"got {type(many).__name__}: pass to_arrays\(...\) of many$"):
            to_matrix(many)


def test_of_another_message_only_the_type_is_named():
    with pytest.raises(TypeError, match="Pose, got Twist$"):
        to_matrix(Twist())
    with pytest.raises(TypeError, match="Pose, got SimpleNamespace: .* has no attribute 'orientation'$"):
        to_matrix(SimpleNamespace(position=Point()))


def test_what_is_masked_is_missing():
    matrices = np.ma.masked_array(np.stack([np.eye(4)] * 2), mask=False)
    matrices[1] = np.ma.masked
    _, rotations = to_arrays(matrices)
    assert rotations[0].tolist() == [0, 0, 0, 1] and np.isnan(rotations[1]).all()
    rotations = np.ma.masked_array([[0, 0, 0, 1], [0, 0, 0, 1]], [[False] * 4, [True] * 4])
    assert np.isnan(to_matrix((np.zeros((2, 3)), rotations))).any(axis=(1, 2)).tolist() == [False, True]
    with pytest.raises(ValueError, match="a matrix must be finite"):
        from_matrix(np.ma.masked_array(np.eye(4), mask=np.eye(4)))


@pytest.mark.parametrize("kind", [np.asarray, list])
def test_complex_numbers_are_refused(kind):
    wrong = np.eye(4, dtype=complex)
    for call in (from_matrix, to_arrays if kind is np.asarray else from_matrix, to_rotation):
        with pytest.raises(TypeError, match="numbers: they are complex$"):
            call(kind(wrong))


def test_objects_with_the_fields_will_do():
    duck = SimpleNamespace(
        position=SimpleNamespace(x=1, y=2, z=3), orientation=SimpleNamespace(x=0, y=0, z=1, w=1)
    )
    assert_allclose(to_matrix(duck) @ [1, 0, 0, 1], (1, 3, 3, 1), atol=1e-15)
    assert rotation(from_matrix(to_matrix(duck), TransformStamped)) == pytest.approx(
        (0, 0, math.sqrt(0.5), math.sqrt(0.5))
    )


def header():
    return transform("map", "base", 7.25).header


class TestHeaders:
    def test_a_child_frame_makes_a_stamped_transform(self):
        got = from_matrix(np.eye(4), header=header(), child_frame_id="base")
        assert got == transform("map", "base", 7.25)

    @pytest.mark.parametrize("cls", [TransformStamped, PoseStamped])
    def test_the_header_is_a_copy(self, cls):
        given = header()
        got = from_matrix(np.eye(4), cls, header=given)
        given.stamp.sec, given.frame_id = 99, "other"
        assert got.header == header()

    @pytest.mark.parametrize("arguments", [(), (Transform,), (Pose,)])
    def test_a_header_needs_a_stamped_message(self, arguments):
        with pytest.raises(TypeError, match="has no header: pass child_frame_id, too, or a stamped"):
            from_matrix(np.eye(4), *arguments, header=header())

    @pytest.mark.parametrize("cls", [Transform, Pose, PoseStamped])
    def test_a_child_frame_needs_a_transform(self, cls):
        with pytest.raises(TypeError, match=f"{cls.__name__} has no child_frame_id"):
            from_matrix(np.eye(4), cls, child_frame_id="base")


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

    @given(pairs)
    def test_they_become_the_arrays_they_came_from(self, pair):
        translations, rotations = to_arrays(to_matrix(pair))
        assert translations.dtype == rotations.dtype == np.float64
        assert np.array_equal(translations, pair[0])
        assert rotations.shape == pair[1].shape and (rotations[:, 3] >= 0).all()
        units = pair[1] / np.linalg.norm(pair[1], axis=1, keepdims=True)
        assert_allclose(np.abs((rotations * units).sum(axis=1)), 1, rtol=0, atol=2e-15)
        assert_allclose(to_matrix((translations, rotations)), to_matrix(pair), rtol=0, atol=4e-15)

    @pytest.mark.parametrize("axis", np.vstack([np.eye(3), [[1, 1, 1], [-1, 2, 0.001], [0, -1e-9, 1]]]))
    def test_turns_near_180_degrees_lose_nothing(self, axis):
        axis = axis / np.linalg.norm(axis)
        angles = math.pi + np.array([0, 1e-16, 1e-12, -1e-12, 1e-8, -1e-8, 1e-4, -1e-4])
        turns = Rotation.from_rotvec(angles[:, None] * axis)
        _, rotations = to_arrays(to_matrix((np.zeros((8, 3)), turns.as_quat())))
        # The scalar product of two quaternions, but more exactly: the angle between them.
        between = (turns.inv() * Rotation.from_quat(rotations)).magnitude()
        assert between.max() < 1e-15

    def test_any_shape_may_stand_before(self):
        pair = np.zeros((2, 5, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (2, 5, 1))
        assert to_matrix(pair).shape == (2, 5, 4, 4)
        assert [part.shape for part in to_arrays(to_matrix(pair))] == [(2, 5, 3), (2, 5, 4)]
        assert np.array_equal(to_matrix(([0, 0, 0], [0, 0, 0, 1])), np.eye(4))
        assert [part.shape for part in to_arrays(np.eye(4))] == [(3,), (4,)]

    def test_what_is_given_stays_as_it_is(self):
        pair = np.ones((2, 3)), np.full((2, 4), 2.0)
        matrices = to_matrix(pair)
        assert (pair[0] == 1).all() and (pair[1] == 2).all()
        kept = matrices.copy()
        for part in to_arrays(matrices):
            part[:] = 7
        assert np.array_equal(matrices, kept)

    def test_what_is_missing_stays_nan(self):
        pair = np.arange(9.0).reshape(3, 3), np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
        pair[0][1] = pair[1][1] = math.nan
        matrices = to_matrix(pair)
        assert np.isnan(matrices[1]).all() and np.isfinite(matrices[[0, 2]]).all()
        translations, rotations = to_arrays(matrices)
        assert np.array_equal(translations, pair[0], equal_nan=True)
        assert np.array_equal(rotations, pair[1], equal_nan=True)

    def test_a_message_takes_one_matrix(self):
        with pytest.raises(ValueError, match=r"shape \(4, 4\), got \(3, 4, 4\); to_arrays takes many"):
            from_matrix(np.stack([np.eye(4)] * 3))

    @pytest.mark.parametrize("pair", [(np.zeros((2, 3)),), (np.zeros((2, 3)), np.ones((2, 4)), None), ()])
    def test_a_tuple_that_is_no_pair_is_a_type_error(self, pair):
        with pytest.raises(TypeError, match=r"tuple \(translations, rotations\), got a tuple of \d"):
            to_matrix(pair)

    @pytest.mark.parametrize(
        ("translations", "rotations"),
        [((2, 3), (3, 4)), ((2, 4), (2, 3)), ((2, 3), (4,)), ((3,), (2, 4)), ((), ())],
    )
    def test_other_shapes_are_a_value_error(self, translations, rotations):
        with pytest.raises(ValueError, match=r"shapes \(N, 3\) and \(N, 4\), got \("):
            to_matrix((np.ones(translations), np.ones(rotations)))

    @pytest.mark.parametrize("wrong", [(0, 0, 0, 0), (math.nan, 0, 0, 1), (0, math.inf, 0, 0)])
    def test_a_rotation_without_length_is_named_by_its_index(self, wrong):
        rotations = np.tile([0.0, 0.0, 0.0, 1.0], (2, 3, 1))
        rotations[1, 2] = wrong
        rotations[0, 0] = math.nan  # missing, and not counted
        with pytest.raises(ValueError, match=r"^rotations\[1, 2\] must have a finite length above zero"):
            to_matrix((np.zeros((2, 3, 3)), rotations))
        with pytest.raises(ValueError, match="^the rotation must have a finite length above zero"):
            to_matrix(((0, 0, 0), wrong))

    @pytest.mark.parametrize(
        ("wrong", "reason"),
        [
            (np.diag([2.0, 2.0, 2.0, 1.0]), "orthogonal; R R.T is off by 3$"),
            (np.diag([1.0, 1.0, 1.0 + 1e-4, 1.0]), "orthogonal; R R.T is off by 0.0002$"),
            (np.diag([1.0, 1.0, -1.0, 1.0]), "reflection"),
            (np.diag([1.0, 1.0, 1.0, 2.0]), "last row"),
            (np.diag([1.0, 1.0, 1.0, math.nan]), "finite"),
        ],
    )
    def test_a_matrix_that_is_no_rigid_transform_is_named_by_its_index(self, wrong, reason):
        matrices = np.stack([np.eye(4), np.full((4, 4), math.nan), np.eye(4), wrong])
        with pytest.raises(ValueError, match=rf"^matrices\[3\]: .*{reason}"):
            to_arrays(matrices)

    @pytest.mark.parametrize("shape", [(4,), (0,), (3, 4), (4, 4, 3)])
    def test_an_array_of_another_shape_is_a_value_error(self, shape):
        with pytest.raises(ValueError, match=r"shape \(4, 4\)"):
            to_arrays(np.zeros(shape))


class TestSciPy:
    @given(turns)
    def test_a_message_becomes_the_rotation_that_scipy_makes(self, q):
        t = transform("map", "base", 0, (1, 2, 3), q)
        quaternion = t.transform.rotation
        for msg in (t, t.transform, pose_of(t), quaternion, QuaternionStamped(quaternion=quaternion)):
            got = to_rotation(msg)
            assert isinstance(got, Rotation)
            assert_allclose(got.as_quat(), turn(q).as_quat(), rtol=0, atol=1e-15)

    @given(turns)
    def test_a_rotation_becomes_the_message_it_came_from(self, q):
        got = from_rotation(turn(q))
        assert type(got) is Quaternion and got.w >= 0
        assert_allclose(abs(xyzw(got) @ turn(q).as_quat()), 1, rtol=0, atol=1e-15)
        assert_allclose(np.linalg.norm(xyzw(got)), 1, rtol=0, atol=1e-15)
        assert_allclose(to_rotation(got).as_matrix(), turn(q).as_matrix(), rtol=0, atol=1e-12)

    @given(pairs)
    def test_arrays_become_as_many_rotations(self, pair):
        units = pair[1] / np.linalg.norm(pair[1], axis=1, keepdims=True)
        for rotations in (pair, pair[1]):
            assert_allclose(to_rotation(rotations).as_quat(), units, rtol=0, atol=1e-15)

    @pytest.mark.parametrize("wrong", [None, 5, Twist()], ids=lambda w: type(w).__name__)
    def test_another_object_is_a_type_error(self, wrong):
        with pytest.raises(TypeError, match="expected a TransformStamped, Transform, PoseStamped or Pose"):
            to_rotation(wrong)
        with pytest.raises(TypeError, match="expected a Rotation of SciPy, got"):
            from_rotation(wrong)

    def test_a_message_holds_one_finite_rotation(self):
        with pytest.raises(ValueError, match="holds one rotation, not 3: as_quat"):
            from_rotation(Rotation.identity(3))
        with pytest.raises(ValueError, match="finite"):
            from_rotation(to_rotation([math.nan] * 4))

    def test_without_scipy_the_error_says_what_to_install(self, monkeypatch):
        class WithoutSciPy(importlib.abc.MetaPathFinder):
            def find_spec(self, name, path, target=None):
                if name.partition(".")[0] == "scipy":
                    raise ModuleNotFoundError(f"No module named {name!r}", name="scipy")

        for name in [name for name in sys.modules if name.partition(".")[0] == "scipy"]:
            monkeypatch.delitem(sys.modules, name)
        monkeypatch.setattr(sys, "meta_path", [WithoutSciPy(), *sys.meta_path])
        advice = re.escape("pip install 'tf2-ros-cython[scipy]'")
        with pytest.raises(ImportError, match=f"to_rotation needs SciPy: {advice}"):
            to_rotation(Transform())

    def test_scipy_is_imported_only_when_it_is_needed(self):
        code = "import sys, tf2_ros.numpy; print('scipy' in sys.modules, 'pandas' in sys.modules)"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stdout) == (0, "False False\n"), done.stderr


def columns_of_three():
    translations = np.arange(9.0).reshape(3, 3)
    rotations = np.array([(0.0, 0.0, 0.0, 2.0), (0.5, -0.5, 0.5, -0.5), (math.nan,) * 4])
    translations[2] = math.nan
    return to_columns((translations, rotations), [S, 2 * S, 3 * S])


class TestDataFrames:
    def test_the_columns_hold_times_translations_and_rotations(self):
        got = columns_of_three()
        assert list(got) == ["stamp_ns", "x", "y", "z", "qx", "qy", "qz", "qw"]
        assert [column.dtype for column in got.values()] == [np.int64] + [np.float64] * 7
        assert got["stamp_ns"].tolist() == [S, 2 * S, 3 * S]
        rows = np.array([got[name] for name in ("x", "y", "z", "qx", "qy", "qz", "qw")]).T
        assert rows[:2].tolist() == [[0, 1, 2, 0, 0, 0, 1], [3, 4, 5, 0.5, -0.5, 0.5, -0.5]]
        assert np.isnan(rows[2]).all()

    def test_pandas_takes_them(self):
        pandas = pytest.importorskip("pandas")
        frame = pandas.DataFrame(columns_of_three())
        assert frame.shape == (3, 8) and len(frame.dropna()) == 2
        assert pandas.to_datetime(frame.stamp_ns)[1] == pandas.Timestamp(2 * S)

    def test_stamped_messages_have_times_of_their_own(self):
        t = transform("map", "base", 7.25, (1, 2, 3), (0.5, 0.5, 0.5, 0.5))
        got = to_columns(iter([t, PoseStamped(header=t.header, pose=pose_of(t))]))
        assert got["stamp_ns"].tolist() == [7_250_000_000] * 2
        assert got["y"].tolist() == [2, 2] and got["qw"].tolist() == [0.5, 0.5]

    def test_a_tuple_of_two_messages_is_no_pair_of_arrays(self):
        msgs = transform("map", "base", 1), transform("map", "base", 2)
        assert to_columns(msgs)["stamp_ns"].tolist() == [S, 2 * S]
        with pytest.raises(TypeError, match="pass no times"):
            to_columns(msgs, [1, 2])

    def test_times_may_be_datetime64(self):
        pair = [[0, 0, 0]], [[0, 0, 0, 1]]
        assert to_columns(pair, np.array(["1970-01-01T00:00:02"], "M8[s]"))["stamp_ns"].tolist() == [2 * S]

    def test_messages_without_a_stamp_are_a_type_error(self):
        with pytest.raises(TypeError, match=r"stamped messages, or a tuple .*, got Transform"):
            to_columns([Transform()])

    def test_times_belong_to_arrays_alone(self):
        with pytest.raises(TypeError, match="pass the times"):
            to_columns(([[0, 0, 0]], [[0, 0, 0, 1]]))
        with pytest.raises(TypeError, match="pass no times"):
            to_columns([transform("map", "base")], [1])

    @pytest.mark.parametrize(
        "pair",
        [
            (np.zeros((1, 3)), np.ones((1, 4))),
            (np.zeros(3), np.ones(4)),
            (np.zeros((2, 2, 3)), np.ones((2, 2, 4))),
        ],
    )
    def test_each_transform_has_one_time(self, pair):
        with pytest.raises(ValueError, match="2 times, but rotations of shape"):
            to_columns(pair, [1, 2])
