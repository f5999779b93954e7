"""The argument `trajectory`: a recording is corrected by the poses that a SLAM has written to a file."""

import math
from dataclasses import replace

import numpy as np
import pytest
from making_bags import S, drive, write_mcap
from making_objects import about_z
from numpy.testing import assert_allclose
from pickles_and_copies import held

from tf2_ros.numpy import to_matrix
from tf2_ros_tools import bag
from tf2_ros_tools.recordings.pose_tables import as_tum, look_up_table

pytestmark = pytest.mark.ours

COUNT, STEP_NS, BEGIN_NS = 100, S // 10, 100 * S
STAMPS = BEGIN_NS + np.arange(COUNT) * STEP_NS
KEYFRAMES = STAMPS[5:-5:5] + 12_345_678  # between the samples of the odometry


@pytest.fixture
def path(tmp_path):
    return write_mcap(tmp_path / "drive.mcap", drive(COUNT))


def odometry(buffer, times):
    return buffer.lookup_matrices("odom", "base", times)


def drift(times):
    """What a SLAM has found out, which changes linearly."""
    seconds = (np.asarray(times) - BEGIN_NS) / S
    return to_matrix(([[0.3 * s, -0.1 * s, 0.0] for s in seconds], [about_z(0.0)] * len(seconds)))


def written(tmp_path, times, matrices, name="optimized.tum"):
    angles = np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])
    lines = [
        f"{ns // S}.{ns % S:09d} {x!r} {y!r} {z!r} 0 0 {math.sin(a / 2)!r} {math.cos(a / 2)!r}\n"
        for ns, (x, y, z), a in zip(times.tolist(), matrices[:, :3, 3].tolist(), angles.tolist(), strict=True)
    ]
    (tmp_path / name).write_text("".join(["# timestamp tx ty tz qx qy qz qw\n", "\n", *lines]))
    return bag.Trajectory(tmp_path / name, "map", "odom", "base")


@pytest.fixture
def optimized(path, tmp_path):
    recorded = bag.load(path)
    return written(tmp_path, KEYFRAMES, drift(KEYFRAMES) @ odometry(recorded, KEYFRAMES))


def test_the_robot_was_where_the_file_says(path, optimized):
    buffer = bag.load(path, trajectory=optimized)
    inside = STAMPS[(KEYFRAMES[0] <= STAMPS) & (STAMPS <= KEYFRAMES[-1])]
    got = buffer.lookup_matrices("map", "base", inside)
    assert_allclose(got, drift(inside) @ odometry(buffer, inside), atol=1e-9)
    # By default, what was before remains, and the last correction holds to the end.
    before = STAMPS[:5]
    recorded = bag.load(path)
    for frame in ("base", "camera"):
        got, wanted = (one.lookup_matrices("map", frame, before) for one in (buffer, recorded))
        assert np.array_equal(got, wanted)
    end = buffer.lookup_matrix("map", "odom", int(STAMPS[-1]))
    assert_allclose(end, drift(KEYFRAMES[-1:])[0], atol=1e-9)


def test_the_own_path_changes_nothing(path, tmp_path):
    recorded = bag.load(path)
    (tmp_path / "own.tum").write_bytes(as_tum(look_up_table(recorded, "map", "base", STAMPS)))
    buffer = bag.load(path, trajectory=bag.Trajectory(tmp_path / "own.tum", "map", "odom", "base"))
    times = np.arange(STAMPS[0], STAMPS[-1], 7_654_321)
    got, wanted = (one.lookup_matrices("map", "camera", times) for one in (buffer, recorded))
    assert_allclose(got, wanted, rtol=0, atol=1e-12)


def test_its_options_are_those_of_correct(path, optimized):
    held_before = bag.load(path, trajectory=replace(optimized, before="hold", after="keep"))
    first = held_before.lookup_matrix("map", "odom", int(STAMPS[0]))
    assert_allclose(first, drift(KEYFRAMES[:1])[0], atol=1e-9)
    last = held_before.lookup_matrix("map", "odom", int(STAMPS[-1]))
    assert np.array_equal(last, bag.load(path).lookup_matrix("map", "odom", int(STAMPS[-1])))


def test_poses_without_odometry_are_an_error_or_reported(path, tmp_path):
    times = np.array([BEGIN_NS, 10 * BEGIN_NS, BEGIN_NS + S])
    late = written(tmp_path, times, drift(times))
    with pytest.raises(bag.BagError, match=r"optimized.tum: times\[1\]: .*future.* of its first pose"):
        bag.load(path, trajectory=late)
    with pytest.warns(UserWarning, match=r"1 of the 3 poses in .*tum is left out, because base in odom"):
        buffer = bag.load(path, trajectory=replace(late, on_missing="skip"))
    assert_allclose(buffer.lookup_matrix("map", "base", BEGIN_NS), drift(times[:1])[0], atol=1e-9)


def test_a_cache_knows_the_content_of_the_file(path, optimized, tmp_path):
    def load(trajectory=optimized):
        return bag.load(path, trajectory=trajectory, cache=tmp_path / "cache")

    first = load()
    assert held(load()) == held(first) == held(bag.load(path, trajectory=optimized))
    assert held(bag.load(path, cache=tmp_path / "cache")) != held(first)
    assert held(load(replace(optimized, before="hold"))) != held(first)
    text = optimized.path.read_text().splitlines(keepends=True)
    optimized.path.write_text("".join(text[:-1]))
    assert held(load()) != held(first)
    optimized.path.write_text("".join(text))
    assert held(load()) == held(first)


WRONG = {
    "1 2 3\n": "line 1: expected 8 numbers",
    "# only a comment\n": "expected lines of 8 numbers",
    "1 0 0 0 0 0 0 1\n100,5 0 0 0 0 0 0 1\n": "line 2: expected 8 numbers.* got '100,5 0",
    "1 0 0 0 0 0 nan 1\n": "line 1: expected 8 numbers",
    "-1 0 0 0 0 0 0 1\n": "line 1: expected 8 numbers",
    "1e40 0 0 0 0 0 0 1\n": "line 1: expected 8 numbers",
    "NaN 0 0 0 0 0 0 1\n": "line 1: expected 8 numbers",
    "100.5 0 0 0 0 0 0 0\n": "must have a finite, non-zero length",
    "0 0 0 0 0 0 0 1\n": "expected a time above 0",
}


@pytest.mark.parametrize("content", WRONG)
def test_a_broken_file_is_named(path, tmp_path, content):
    (tmp_path / "broken.tum").write_text(content)
    with pytest.raises(bag.BagError, match=rf"broken.tum.*{WRONG[content]}"):
        bag.load(path, trajectory=bag.Trajectory(tmp_path / "broken.tum", "map", "odom", "base"))


def test_stamps_keep_all_digits(path, tmp_path):
    lines = [f"{stamp} 1 2 3 0 0 0 1\n" for stamp in ("101.123456789", "1.02e2", "1.02234567890e+02")]
    (tmp_path / "exact.tum").write_text("".join(lines))
    buffer = bag.load(path, trajectory=bag.Trajectory(tmp_path / "exact.tum", "map", "odom", "base"))
    stamps = buffer.histories()["odom"].stamps_ns.tolist()
    assert {101_123_456_789, 102 * S, 102_234_567_890} <= set(stamps)


def test_other_arguments_are_refused(path, tmp_path):
    with pytest.raises(TypeError, match="trajectory: expected a Trajectory, got str"):
        bag.load(path, trajectory="optimized.tum")
    with pytest.raises(FileNotFoundError):
        bag.load(path, trajectory=bag.Trajectory(tmp_path / "none.tum", "map", "odom", "base"))
