# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Covariances through transforms: those of messages, and of motions that are sampled and differentiated."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovariance, Transform
from hypothesis import given
from numpy.testing import assert_allclose
from random_messages import transforms
from rotations import Turn
from times_and_transforms import transform

from tf2_geometry_msgs import do_transform_pose_with_covariance
from tf2_ros.numpy import propagate, to_arrays, to_matrix


def covariances(count):
    roots = np.random.default_rng(3).normal(size=(count, 6, 6))
    return roots @ roots.transpose(0, 2, 1)


def poses(count, seed=4):
    random = np.random.default_rng(seed)
    return random.normal(size=(count, 3)), Turn.random(random, count).q


def erred(pose, error):
    """A pose after an error as in a PoseWithCovariance: x y z, then a turn of the body about fixed axes."""
    moved = pose.copy()
    moved[:3, 3] += error[:3]
    moved[:3, :3] = Turn.from_vector(error[3:]).as_matrix() @ pose[:3, :3]
    return moved


def error_between(pose, moved):
    turn = moved[:3, :3] @ pose[:3, :3].T
    # It is so small that its sine is its angle.
    turn = (turn[[2, 0, 1], [1, 2, 0]] - turn[[1, 2, 0], [2, 0, 1]]) / 2
    return np.concatenate([moved[:3, 3] - pose[:3, 3], turn])


def jacobian(function, step=1e-6):
    """Of six numbers, at zero; by central differences."""
    columns = [(function(step * e) - function(-step * e)) / (2 * step) for e in np.eye(6)]
    return np.stack(columns, axis=1)


@given(transforms)
def test_by_default_covariances_are_those_of_the_messages(t):
    many = covariances(5)
    got = propagate(many, t)
    for covariance, result in zip(many, got, strict=True):
        message = do_transform_pose_with_covariance(PoseWithCovariance(covariance=covariance.ravel()), t)
        assert_allclose(result.ravel(), message.covariance, rtol=1e-12, atol=1e-12)


def test_each_covariance_is_propagated_by_its_own_transform_and_what_is_missing_is_nan():
    many, (translations, rotations) = covariances(20), poses(20)
    translations[1] = rotations[1] = np.nan
    for lever_arm in (False, True):
        got = propagate(many, (translations, rotations), lever_arm=lever_arm)
        assert got.dtype == np.float64 and got.shape == (20, 6, 6)
        assert np.isnan(got[1]).all() and np.isfinite(got[[0, 2]]).all()
        for i in range(20):
            one = (translations[i], rotations[i])
            assert_allclose(got[i], propagate(many[i], one, lever_arm=lever_arm), rtol=1e-13)
            assert_allclose(got[i], got[i].T, rtol=1e-12, atol=1e-12)


def test_with_a_lever_arm_it_is_the_linearised_motion_of_the_other_frame():
    covariance = covariances(1)[0]
    for target_from_source, pose in zip(to_matrix(poses(10)), to_matrix(poses(10, seed=5)), strict=True):
        # Both frames are those of one body, each with its error in its own axes.
        source_from_target = np.linalg.inv(target_from_source)

        def target_error(error, pose=pose, mount=source_from_target):
            moved = pose @ erred(np.eye(4), error)
            return error_between(np.eye(4), np.linalg.inv(pose @ mount) @ moved @ mount)

        j = jacobian(target_error)
        got = propagate(covariance, to_one(target_from_source), lever_arm=True)
        assert_allclose(got, j @ covariance @ j.T, rtol=1e-6, atol=1e-6)


def to_one(matrix):
    """The pair of arrays of one matrix."""
    translations, rotations = to_arrays(matrix[None])
    return translations[0], rotations[0]


def test_one_transform_serves_all_covariances_and_one_covariance_all_transforms():
    many, (translations, rotations) = covariances(6), poses(6)
    t = transform("map", "base", 0, translations[0], rotations[0])
    assert_allclose(
        propagate(many, t), propagate(many, (np.tile(translations[0], (6, 1)), np.tile(rotations[0], (6, 1))))
    )
    assert propagate(many[0], (translations, rotations)).shape == (6, 6, 6)
    assert propagate(many[0], t).shape == (6, 6)
    shaped = translations.reshape(2, 3, 3), rotations.reshape(2, 3, 4)
    assert propagate(many.reshape(2, 3, 6, 6), shaped).shape == (2, 3, 6, 6)


@pytest.mark.parametrize(
    ("covariances", "transforms", "error", "text"),
    [
        (np.eye(3), Transform(), ValueError, r"shape \(N, 6, 6\), got \(3, 3\)"),
        (np.zeros(36), Transform(), ValueError, r"shape \(N, 6, 6\), got \(36,\)"),
        ("no numbers", Transform(), TypeError, "covariances: expected numbers"),
        (
            np.eye(6) * 1j,
            Transform(),
            TypeError,
            "covariances: expected numbers: complex numbers are",
        ),
        (np.zeros((2, 6, 6)), poses(3), ValueError, r"shape \(2, 6, 6\) for rotations of shape \(3, 4\)"),
        (np.zeros((1, 6, 6)), poses(3), ValueError, r"shape \(1, 6, 6\) for rotations of shape \(3, 4\)"),
        (np.eye(6), np.eye(4), TypeError, "expected a TransformStamped"),
        (np.eye(6), (np.zeros(3), np.zeros(4)), ValueError, "finite, non-zero length, got "),
    ],
)
def test_wrong_arguments(covariances, transforms, error, text):
    with pytest.raises(error, match=text):
        propagate(covariances, transforms)
