# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The argument `trajectory`: a recording is corrected by the poses that a SLAM has exported or published."""

import math
import os
import sys
import threading
from dataclasses import replace
from pathlib import Path
from subprocess import run

import numpy as np
import pytest
from making_bags import (
    FORMATS,
    STAMPED,
    S,
    Sent,
    Tf,
    drive,
    posed,
    slam_path,
    write_mcap,
    write_ros1,
)
from numpy.testing import assert_allclose
from pickles_and_copies import held
from times_and_transforms import about_z

from tf2_ros.numpy import to_matrix
from tf2_ros_tools import bag
from tf2_ros_tools.recordings.bag_loader import read_contents
from tf2_ros_tools.recordings.pose_tables import as_tum, look_up_table

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
    table, _ = look_up_table(read_contents(path), "map", ["base"], STAMPS)
    (tmp_path / "own.tum").write_bytes(as_tum(table))
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


def test_if_no_pose_can_be_used_the_reason_is_that_of_the_first(path, tmp_path):
    early = written(tmp_path, STAMPS[:3] - 50 * S, drift(STAMPS[:3]))
    inside = written(tmp_path, STAMPS[:3], drift(STAMPS[:3]), "inside.tum")
    steps = [[Tf("map", "odom", ns), Tf("other", "base", ns)] for ns in STAMPS.tolist()]
    apart = write_mcap(tmp_path / "apart.mcap", [Sent(own[0].ns, "/tf", own) for own in steps])
    parked = [own[:1] + [Tf("odom", "base", own[0].ns)] * (i < 30) for i, own in enumerate(steps)]
    old = write_mcap(tmp_path / "old.mcap", [Sent(own[0].ns, "/tf", own) for own in parked])
    for recording, trajectory, how, text in (
        (path, early, {}, "Requested time 50.000000000 but the earliest data is at time 100.000"),
        (apart, inside, {}, "not part of the same tree"),
        (old, inside, {"cache_time": 5.0}, "more than cache_time, 5.000000000 s, before 109.900000000 s"),
    ):
        for on_missing, none in (("raise", ""), ("skip", "none of its poses can be used: ")):
            with pytest.raises(bag.BagError, match=rf"tum: {none}times\[0\]: .*{text}") as raised:
                bag.load(recording, trajectory=replace(trajectory, on_missing=on_missing), **how)
            advised = "leaves such poses out" in str(raised.value)
            assert advised == (recording == path and on_missing == "raise")


def test_a_pose_at_a_time_that_no_stamp_can_hold_is_named(tmp_path):
    poses = [posed(ns, 1.0, "", STAMPED) for ns in (100 * S, 101 * S)]
    stamp = poses[1].content["header"].stamp
    stamp.sec, stamp.nanosec = 2**31 - 1, S  # nanoseconds beyond a second are added to the seconds
    path = write_mcap(tmp_path / "run.mcap", [*drive(COUNT), slam_path(101 * S, poses)])
    with pytest.raises(bag.BagError, match=r"slam/path: times\[1\]: the time 2147483648.0* s does not fit"):
        bag.load(path, trajectory=bag.Trajectory("/slam/path", "map", "odom", "base"))


def test_only_an_error_with_a_time_says_which_pose_has_it(path, optimized):
    wrong = {
        '"odm" .* does not exist': {"child": "odm"},
        r"the path between them at times\[0\]": {"moving": "map"},
    }
    for text, changed in wrong.items():
        with pytest.raises(bag.BagError, match=text) as raised:
            bag.load(path, trajectory=replace(optimized, **changed))
        explained = "(times[0] is that of its first pose)" in str(raised.value)
        assert explained == ("moving" in changed)


def test_a_rounded_stamp_at_an_end_of_the_odometry_is_used_there(tmp_path):
    begin_ns = 1_700_000_000_123_456_789
    path = write_mcap(tmp_path / "drive.mcap", drive(COUNT, begin_ns=begin_ns))
    ends = [begin_ns, begin_ns + (COUNT - 1) * STEP_NS]
    matrices = to_matrix(([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], [about_z(0.1)] * 2))
    for digits in 9, 8, 7, 6:  # the first one is up to 211 ns after the first odometry
        lines = [
            f"{ns / S:.{digits}f} {x} {y} {z} 0 0 {math.sin(0.05)!r} {math.cos(0.05)!r}\n"
            for ns, (x, y, z) in zip(ends, matrices[:, :3, 3].tolist(), strict=True)
        ]
        (tmp_path / "rounded.tum").write_text("".join(lines))
        buffer = bag.load(path, trajectory=bag.Trajectory(tmp_path / "rounded.tum", "map", "odom", "base"))
        assert_allclose(buffer.lookup_matrices("map", "base", ends), matrices, rtol=0, atol=1e-5)
    (tmp_path / "rounded.tum").write_text(f"{(begin_ns - 2_000) / S:.7f} 0 0 0 0 0 0 1\n")
    with pytest.raises(bag.BagError, match='past.*on_missing="skip" leaves such poses out'):
        bag.load(path, trajectory=bag.Trajectory(tmp_path / "rounded.tum", "map", "odom", "base"))


# The formats of files.


def lines_of(trajectory):
    return trajectory.path.read_text().splitlines()[2:]


SPELT = {
    "commas": lambda lines: "\n".join(line.replace(" ", ",") for line in lines),
    "commas and spaces, and a heading": lambda lines: "\r\n".join(
        ["timestamp, tx, ty, tz, qx, qy, qz, qw", *(line.replace(" ", ", ") for line in lines)]
    ),
    "unsorted, with comments and empty lines": lambda lines: "\n".join(
        ["\ufeff# by a SLAM", *lines[::-1], "  # the end", "", "\t"]
    ),
    "a keyframe twice": lambda lines: "\n".join([lines[3], *lines]),
    "numpy's floats": lambda lines: "\n".join(
        " ".join([line.split()[0], *(f"{float(one):.18e}" for one in line.split()[1:])]) for line in lines
    ),
}


@pytest.mark.parametrize("spelt", SPELT)
def test_a_file_may_be_written_in_several_ways(path, optimized, spelt):
    wanted = held(bag.load(path, trajectory=optimized))
    optimized.path.write_text(SPELT[spelt](lines_of(optimized)))
    assert held(bag.load(path, trajectory=optimized)) == wanted


def kitti(tmp_path, times, matrices, digits=17):
    rows = [" ".join(f"{one:.{digits}e}" for one in matrix[:3].ravel()) for matrix in matrices]
    (tmp_path / "poses.txt").write_text("\n".join(rows))
    (tmp_path / "times.txt").write_text("".join(f"{ns // S}.{ns % S:09d}\n" for ns in times.tolist()))
    return bag.Trajectory(tmp_path / "poses.txt", "map", "odom", "base", times=tmp_path / "times.txt")


def test_poses_of_kitti_have_their_times_in_another_file(path, tmp_path):
    matrices = drift(KEYFRAMES) @ odometry(bag.load(path), KEYFRAMES)
    for digits, atol in ((17, 1e-12), (6, 1e-5)):  # KITTI's own files have six digits after the point
        buffer = bag.load(path, trajectory=kitti(tmp_path, KEYFRAMES, matrices, digits))
        assert_allclose(buffer.lookup_matrices("map", "base", KEYFRAMES), matrices, rtol=0, atol=atol)


def test_wrong_files_of_kitti_are_named(path, tmp_path, optimized):
    good = kitti(tmp_path, KEYFRAMES, drift(KEYFRAMES))
    wrong = {
        "poses.txt, line 1: expected 8 numbers.*KITTI's poses need `times`": replace(good, times=None),
        "optimized.tum, line 3: expected 12 numbers": replace(optimized, times=good.times),
        "poses.txt, line 1: expected one number, a stamp in seconds, got": replace(good, times=good.path),
    }
    for text, trajectory in wrong.items():
        with pytest.raises(bag.BagError, match=text):
            bag.load(path, trajectory=trajectory)
    with pytest.raises(bag.BagError, match=r"the 18 poses in .*poses.txt, got 17 in .*times.txt"):
        bag.load(path, trajectory=kitti(tmp_path, KEYFRAMES[:-1], drift(KEYFRAMES)))
    with pytest.raises(bag.BagError, match=r"poses.txt: matrices\[0\]: its rotation must be orthogonal"):
        bag.load(path, trajectory=kitti(tmp_path, KEYFRAMES, 1.1 * drift(KEYFRAMES)))


# A topic of the recording.


POSES = [posed(int(ns), float(i), "", STAMPED) for i, ns in enumerate(KEYFRAMES)]
X = np.arange(len(POSES), dtype=float)
ON_TOPIC = bag.Trajectory("/slam/path", "map", "odom", "base")


def with_paths(*paths):
    return sorted([*drive(COUNT), *paths], key=lambda one: one.log_ns)


LAST = slam_path(BEGIN_NS + 3 * S, POSES)
# The path grows, and the last message counts, long before the end of the recording.
GROWING = with_paths(*(slam_path(BEGIN_NS + i * S, POSES[:i]) for i in (1, 2)), LAST)


@pytest.mark.parametrize(
    "kind", ["folder-mcap", "folder-sqlite3", "split-mcap", "mcap-no-index", "mcap-file"]
)
def test_the_last_path_on_a_topic_counts(tmp_path, kind):
    buffer = bag.load(FORMATS[kind](tmp_path, GROWING), trajectory=ON_TOPIC)
    got = buffer.lookup_matrices("map", "base", KEYFRAMES)
    assert_allclose(got[:, 0, 3], X, rtol=0, atol=1e-9)
    assert_allclose(got[:, :2, 0], np.array([np.cos(X), np.sin(X)]).T, rtol=0, atol=1e-9)


def test_a_path_of_ros_1_is_read_and_counts_whatever_the_part_that_is_loaded(tmp_path):
    poses = [posed(int(ns), float(i), "", STAMPED, ros=1) for i, ns in enumerate(KEYFRAMES)]
    path = write_ros1(tmp_path / "run.bag", with_paths(slam_path(BEGIN_NS + 30 * S, poses, ros=1)))
    skipping = replace(ON_TOPIC, on_missing="skip")
    with pytest.warns(UserWarning, match="14 of the 18 poses in /slam/path are left out"):
        part = bag.load(path, start=BEGIN_NS + 2 * S, end=BEGIN_NS + 4 * S, trajectory=skipping)
    inside = KEYFRAMES[4:7]
    assert_allclose(part.lookup_matrices("map", "base", inside)[:, 0, 3], X[4:7], rtol=0, atol=1e-9)


def test_a_path_without_stamps_or_in_another_frame_is_refused(tmp_path):
    def load(*paths, **changed):
        path = write_mcap(tmp_path / "drive.mcap", with_paths(*paths))
        return bag.load(path, trajectory=replace(ON_TOPIC, **changed))

    mixed = [*POSES[:2], posed(int(KEYFRAMES[2]), 0.0, "", STAMPED, frame="odom")]
    unstamped = [posed(0, 0.0, "", STAMPED)] * 2
    wrong = {
        "topic /slam/path: expected poses in 'map', got poses in 'odom'": slam_path(S, POSES, frame="odom"),
        r"poses\[2\]: expected a pose in 'map', got one in 'odom'": slam_path(S, mixed),
        "topic /slam/path: its last message has no poses": slam_path(S, []),
        r"/slam/path: times\[2\]: expected a time above 0": slam_path(S, [*POSES[:2], unstamped[0]]),
        "topic /slam/path, log time 1000000000 ns": Sent(S, "/slam/path", b"\0\1\0\0ab", LAST.msgtype),
        "is neither a file nor a topic of .* with nav_msgs/msg/Path; .*: /b, /c": None,
    }
    for text, last in wrong.items():
        others = [slam_path(S, POSES, topic) for topic in ("/b", "/c")]
        with pytest.raises(bag.BagError, match=text):
            load(*others, *([] if last is None else [last]))
    with pytest.raises(bag.BagError, match="/slam/path: none of its poses can be used: .* a time above 0"):
        load(slam_path(S, unstamped), on_missing="skip")
    # Empty frames of poses are that of the path; a leading slash is that of ROS 1.
    empty = [posed(int(ns), 1.0, "", STAMPED, frame="") for ns in KEYFRAMES]
    assert_allclose(
        load(slam_path(S, empty, frame="/map")).lookup_matrix("map", "base", int(KEYFRAMES[1]))[0, 3], 1
    )


def test_an_absolute_path_of_a_file_is_no_topic(path, optimized):
    absolute = replace(optimized, path=str(optimized.path.absolute()))
    assert held(bag.load(path, trajectory=absolute)) == held(bag.load(path, trajectory=optimized))
    with pytest.raises(FileNotFoundError):
        bag.load(path, trajectory=replace(optimized, path=Path("/slam/path")))


def test_a_pipe_is_read_once(path, optimized, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    writer = threading.Thread(
        target=lambda: (tmp_path / "pipe").write_bytes(optimized.path.read_bytes()), daemon=True
    )
    writer.start()
    buffer = bag.load(path, trajectory=replace(optimized, path=str(tmp_path / "pipe")))
    writer.join()
    assert held(buffer) == held(bag.load(path, trajectory=optimized))


def test_poses_that_are_left_out_are_counted(tmp_path):
    # One is before the odometry, at the stamp of a sample that remains; another one has no stamp.
    early = [posed(ns, 0.0, "", STAMPED) for ns in (BEGIN_NS - S, 0)]
    messages = with_paths(slam_path(BEGIN_NS + 3 * S, [*early, *POSES]))
    sent = messages[1].content
    sent.append(sent[0]._replace(ns=BEGIN_NS - S))
    path = write_mcap(tmp_path / "drive.mcap", messages)
    in_file = kitti(tmp_path, KEYFRAMES - 5 * S, drift(KEYFRAMES))
    for trajectory, text, unset in (
        (ON_TOPIC, "2 of the 20 poses in /slam/path", " or the stamp is 0"),
        (in_file, "9 of the 18 poses in ", ""),
    ):
        text += f".* are left out, because base in odom is not known then or no longer kept{unset}$"
        with pytest.warns(UserWarning, match=text):
            bag.load(path, trajectory=replace(trajectory, on_missing="skip"))


def test_a_recording_that_its_own_path_corrects_is_opened_once(tmp_path):
    """Once to read how it begins, and once by rosbags."""
    write_mcap(tmp_path / "drive.mcap", with_paths(LAST))
    program = f"""
import sys
from tf2_ros_tools import bag
opened = []
sys.addaudithook(lambda event, what: event == "open" and opened.append(str(what[0])))
bag.load("drive.mcap", trajectory={replace(ON_TOPIC, on_missing="skip")}, progress=False)
print(sum(name.endswith("drive.mcap") for name in opened))
"""
    program = program.replace("Trajectory(", "bag.Trajectory(")
    assert run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True).stdout == b"2\n"


def test_equal_poses_at_a_stamp_are_one_and_different_ones_are_left_out(path, optimized):
    lines = optimized.path.read_text().splitlines()
    skipping = replace(optimized, on_missing="skip")
    optimized.path.write_text("\n".join([*lines, lines[-1]]))
    assert held(bag.load(path, trajectory=skipping)) == held(bag.load(path, trajectory=optimized))
    stamp, x, *others = lines[-1].split()
    optimized.path.write_text("\n".join([*lines, " ".join([stamp, f"{float(x) + 1.0}", *others])]))
    with pytest.raises(bag.BagError, match=r"optimized.tum: times\[17\] and times\[18\] are both .* apart"):
        bag.load(path, trajectory=optimized)
    with pytest.warns(UserWarning, match="1 of the 18 poses in .* or others with the same stamp differ$"):
        bag.load(path, trajectory=skipping)


WRONG = {
    "1 2 3\n": "line 1: expected 8 numbers",
    "# only a comment\n": "expected lines of 8 numbers",
    "1 0 0 0 0 0 0 1\n100,5 0 0 0 0 0 0 1\n": "line 2: expected 8 numbers.* got '100,5 0",
    "1 0 0 0 0 0 nan 1\n": "line 1: expected 8 numbers",
    "-1 0 0 0 0 0 0 1\n": "line 1: expected 8 numbers",
    "1e40 0 0 0 0 0 0 1\n": "line 1: expected 8 numbers",
    "NaN 0 0 0 0 0 0 1\n": "line 1: expected 8 numbers",
    "100.5 0 0 0 0 0 0 0\n": "must have a finite, non-zero length",
    "0 0 0 0 0 0 0 1\n": r"times\[0\]: expected a time above 0",
    "1700000000123456789 0 0 0 0 0 0 1\n": "line 1: expected 8 numbers, a stamp in seconds",
    "1 0 0 0 0 0 0 1\nstamp x y z qx qy qz qw\n": "line 2: expected 8 numbers",
    "stamp x y z qx qy qz qw\n": "expected lines of 8 numbers",
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
    with pytest.raises(
        TypeError, match=r"child: expected a str, the name of a frame, got PosixPath\('odom'\)"
    ):
        bag.Trajectory("map", "map", Path("odom"), "base")
