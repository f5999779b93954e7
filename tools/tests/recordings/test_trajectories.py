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
    ODOMETRY,
    PATH,
    STAMPED,
    TRANSFORM,
    WITH_COVARIANCE,
    S,
    Sent,
    Tf,
    drive,
    pose_array,
    posed,
    scan,
    slam_path,
    write_mcap,
    write_ros1,
)
from numpy.testing import assert_allclose
from pickles_and_copies import held
from pose_file_forms import FORMS, Poses
from times_and_transforms import about_z

from tf2_ros.numpy import to_arrays, to_matrix
from tf2_ros_tools import bag
from tf2_ros_tools.recordings.bag_loader import read_contents
from tf2_ros_tools.recordings.pose_tables import as_tum, look_up_table

COUNT, STEP_NS, BEGIN_NS = 100, S // 10, 100 * S
OF_TODAY_NS = 1_700_000_000 * S
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
    with pytest.raises(
        bag.BagError, match='optimized.tum, line 4: Lookup .*future.*; on_missing="skip" leaves'
    ):
        bag.load(path, trajectory=late)
    with pytest.warns(UserWarning, match=r"1 of the 3 poses in .*tum is left out, because base in odom"):
        buffer = bag.load(path, trajectory=replace(late, on_missing="skip"))
    assert_allclose(buffer.lookup_matrix("map", "base", BEGIN_NS), drift(times[:1])[0], atol=1e-9)


def test_if_no_pose_can_be_used_the_reason_is_that_of_the_first(path, tmp_path):
    inside = written(tmp_path, STAMPS[:3], drift(STAMPS[:3]), "inside.tum")
    steps = [[Tf("map", "odom", ns), Tf("other", "base", ns)] for ns in STAMPS.tolist()]
    apart = write_mcap(tmp_path / "apart.mcap", [Sent(own[0].ns, "/tf", own) for own in steps])
    parked = [own[:1] + [Tf("odom", "base", own[0].ns)] * (i < 30) for i, own in enumerate(steps)]
    old = write_mcap(tmp_path / "old.mcap", [Sent(own[0].ns, "/tf", own) for own in parked])
    for recording, trajectory, how, place, text in (
        (apart, inside, {}, r"inside.tum: {}times\[0\]: ", "not part of the same tree"),
        (
            old,
            inside,
            {"cache_time": 5.0},
            r"inside.tum: {}times\[0\]: ",
            "more than cache_time, 5.000000000 s, before",
        ),
    ):
        for on_missing, none in (("raise", ""), ("skip", "none of its poses can be used: ")):
            with pytest.raises(bag.BagError, match=f"{place.format(none)}.*{text}") as raised:
                bag.load(recording, trajectory=replace(trajectory, on_missing=on_missing), **how)
            assert "leaves such poses out" not in str(raised.value)


@pytest.mark.parametrize("shift_ns", [-50 * S, 50 * S])
def test_poses_that_are_all_outside_of_the_odometry_are_refused_with_both_ranges(path, tmp_path, shift_ns):
    times = STAMPS[[0, 0, 7]] + shift_ns  # the poses at the first two differ
    outside = written(tmp_path, times, drift(STAMPS[[0, 1, 7]]), "outside.tum")
    begin, end = (f"{ns // S}.{ns % S:09d} s" for ns in (int(times[0]), int(times[-1])))
    text = (
        f"^[^:]*outside.tum: none of its poses can be used: their stamps are from {begin} to {end}, but base"
        " in odom is known from 100.000000000 s to 109.900000000 s$"
    )
    with pytest.raises(bag.BagError, match=text):
        bag.load(path, trajectory=replace(outside, on_missing="skip", start=0))


def test_a_pose_at_a_time_that_no_stamp_can_hold_is_named(tmp_path):
    poses = [posed(ns, 1.0, "", STAMPED) for ns in (100 * S, 101 * S)]
    stamp = poses[1].content["header"].stamp
    stamp.sec, stamp.nanosec = 2**31 - 1, S  # nanoseconds beyond a second are added to the seconds
    path = write_mcap(tmp_path / "run.mcap", [*drive(COUNT), slam_path(101 * S, poses)])
    with pytest.raises(bag.BagError, match="/slam/path, pose 2: .* cannot hold 2147483648000000000 ns"):
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
            2 * f"{ns / S:.{digits}f} {x} {y} {z} 0 0 {math.sin(0.05)!r} {math.cos(0.05)!r}\n"
            for ns, (x, y, z) in zip(ends, matrices[:, :3, 3].tolist(), strict=True)
        ]
        (tmp_path / "rounded.tum").write_text("".join(lines))
        buffer = bag.load(path, trajectory=bag.Trajectory(tmp_path / "rounded.tum", "map", "odom", "base"))
        assert_allclose(buffer.lookup_matrices("map", "base", ends), matrices, rtol=0, atol=1e-5)
    (tmp_path / "rounded.tum").write_text(f"{(begin_ns - 2_000) / S:.7f} 0 0 0 0 0 0 1\n")
    with pytest.raises(bag.BagError, match='past.*on_missing="skip" leaves such poses out'):
        bag.load(path, trajectory=bag.Trajectory(tmp_path / "rounded.tum", "map", "odom", "base"))


def test_stamps_that_differ_by_less_than_the_rounding_are_not_equal(path, tmp_path):
    ends = [int(STAMPS[0]) + 300, int(STAMPS[0]) + 700, int(STAMPS[-1]) - 900, int(STAMPS[-1]) - 200]
    x = [1.0, 2.0, 3.0, 4.0]
    (tmp_path / "close.tum").write_text(
        "".join(f"{ns // S}.{ns % S:09d} {one} 0 0 0 0 0 1\n" for ns, one in zip(ends, x, strict=True))
    )
    buffer = bag.load(path, trajectory=bag.Trajectory(tmp_path / "close.tum", "map", "odom", "base"))
    times = [int(STAMPS[0]), ends[1], ends[2], int(STAMPS[-1])]
    assert_allclose(buffer.lookup_matrices("map", "base", times)[:, 0, 3], x, rtol=0, atol=1e-9)


# The formats of files.


@pytest.mark.parametrize("form", FORMS)
def test_a_drive_whose_truth_is_known_is_corrected_by_each_form(path, tmp_path, form):
    truth = drift(KEYFRAMES) @ odometry(bag.load(path), KEYFRAMES)
    poses = Poses([*KEYFRAMES + OF_TODAY_NS], *to_arrays(truth))
    today = write_mcap(tmp_path / "today.mcap", drive(COUNT, begin_ns=BEGIN_NS + OF_TODAY_NS))
    (tmp_path / "poses").write_text(FORMS[form](poses), encoding="utf-8")
    buffer = bag.load(today, trajectory=bag.Trajectory(tmp_path / "poses", "map", "odom", "base"))
    inside = STAMPS[(KEYFRAMES[0] <= STAMPS) & (STAMPS <= KEYFRAMES[-1])]
    wanted = drift(inside) @ odometry(bag.load(path), inside)
    got = buffer.lookup_matrices("map", "base", inside + OF_TODAY_NS)
    assert_allclose(got, wanted, rtol=0, atol=1e-9)


def test_a_user_may_name_the_columns_of_a_file_or_pass_arrays(path, optimized, tmp_path):
    wanted = held(bag.load(path, trajectory=optimized))
    rows = [line.split() for line in optimized.path.read_text().splitlines()[2:]]
    (tmp_path / "poses.csv").write_text("".join(",".join([*row[4:], "map", *row[:4]]) + "\n" for row in rows))
    named = replace(optimized, path=tmp_path / "poses.csv")
    with pytest.raises(
        bag.BagError, match="line 1: expected a heading, .* pass `columns` or --trajectory-columns"
    ):
        bag.load(path, trajectory=named)
    for columns in ("qx qy qz qw - timestamp x y z", "qx,qy,qz,qw,-,t_s,x,y,z"):
        assert held(bag.load(path, trajectory=replace(named, columns=columns))) == wanted
    numbers = np.array(rows, float)
    xyz, xyzw = numbers[:, 1:4], numbers[:, 4:]
    for times in (KEYFRAMES, KEYFRAMES.tolist(), KEYFRAMES.astype("datetime64[ns]")):
        arrays = replace(optimized, path=(xyz, xyzw), times=times)
        assert held(bag.load(path, trajectory=arrays)) == wanted
    buffer = bag.load(path, trajectory=replace(arrays, path=to_matrix((xyz, xyzw))))
    assert_allclose(
        buffer.lookup_matrices("map", "base", KEYFRAMES), to_matrix((xyz, xyzw)), rtol=0, atol=1e-9
    )
    late = bag.load(path, trajectory=replace(arrays, times=KEYFRAMES - BEGIN_NS, start=BEGIN_NS))
    assert held(late) == wanted


def test_wrong_arrays_are_refused(path):
    poses = np.zeros((2, 3)), np.array([[0.0, 0.0, 0.0, 1.0]] * 2)
    for pose, times, error, text in (
        (poses, KEYFRAMES[:1], ValueError, "a stamp for each of the 2 poses, got 1 in `times`$"),
        (poses, [1.5, 2.5], TypeError, "float"),
        ((np.zeros((0, 3)), np.zeros((0, 4))), [], ValueError, r"path: expected N poses, got .*\(0, 3\)"),
        (([0.0] * 3, [0.0, 0.0, 0.0, 1.0]), [1], ValueError, r"path: expected N poses, got .*\(3,\)"),
        ((poses[0], poses[1][:1]), KEYFRAMES[:2], ValueError, "shapes"),
        (
            (poses[0], 2.0 * poses[1]),
            KEYFRAMES[:2],
            bag.BagError,
            "the trajectory, pose 1: .* rotation of length 1",
        ),
        ((poses[0] * np.nan, poses[1]), KEYFRAMES[:2], ValueError, "finite"),
        (poses, [1, -1], bag.BagError, "the trajectory, pose 2: the stamp of a message cannot hold -1 ns"),
    ):
        with pytest.raises(error, match=text):
            bag.load(path, trajectory=bag.Trajectory(pose, "map", "odom", "base", times=times))


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


def test_stamps_that_count_from_a_start_get_it(path, tmp_path):
    begin_ns = OF_TODAY_NS + 5
    times = KEYFRAMES - BEGIN_NS + begin_ns
    today = write_mcap(tmp_path / "today.mcap", [scan(begin_ns - S, 0), *drive(COUNT, begin_ns=begin_ns)])
    matrices = drift(KEYFRAMES) @ odometry(bag.load(path), KEYFRAMES)
    relative = kitti(tmp_path, times - begin_ns, matrices)
    advice = (
        "but the odometry begins at 1700000000.000000005 s; if they count from a start, pass it as `start`"
        " or --trajectory-start; if they are in another unit, name it, as in `timestamp_us`$"
    )
    for on_missing in ("raise", "skip"):
        with pytest.raises(bag.BagError, match=f"poses.txt: its stamps end at 9.012345678 s, {advice}"):
            bag.load(today, trajectory=replace(relative, on_missing=on_missing))
    tum = written(tmp_path, times - begin_ns, matrices)
    for trajectory, start in ((relative, begin_ns), (tum, np.datetime64(begin_ns, "ns"))):
        buffer = bag.load(today, trajectory=replace(trajectory, start=start))
        assert_allclose(buffer.lookup_matrices("map", "base", times), matrices, rtol=0, atol=1e-9)
    # The earliest log time is that of a scan.
    from_log = kitti(tmp_path, times - begin_ns + S, matrices)
    buffer = bag.load(today, trajectory=replace(from_log, start="recording"))
    assert_allclose(buffer.lookup_matrices("map", "base", times), matrices, rtol=0, atol=1e-9)
    with pytest.raises(
        bag.BagError, match="optimized.tum, line 3: the stamp 0.512345678 s is too large to count"
    ):
        bag.load(today, trajectory=replace(tum, start=2**31 * S - 1))


def test_a_start_is_a_time(optimized):
    with pytest.raises(ValueError, match="start: expected a time or 'recording', got 'record'"):
        replace(optimized, start="record")
    with pytest.raises(TypeError, match=r"start: expected nanoseconds .*; round\(seconds \* 1e9\)"):
        replace(optimized, start=1.5)
    for time in (np.datetime64("NaT", "ns"), 10**30):
        with pytest.raises(ValueError, match="start: expected a time that 64-bit nanoseconds can hold, got"):
            replace(optimized, start=time)


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
    check_topic(buffer)


ROS_1_POSES = [posed(int(ns), float(i), "", STAMPED, ros=1) for i, ns in enumerate(KEYFRAMES)]


def test_a_path_of_ros_1_is_read_and_counts_whatever_the_part_that_is_loaded(tmp_path):
    path = write_ros1(tmp_path / "run.bag", with_paths(slam_path(BEGIN_NS + 30 * S, ROS_1_POSES, ros=1)))
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
        "topic /slam/path, log time .*: the path is in 'odom', but its pose 1 is in 'map'": slam_path(
            S, POSES, frame="odom"
        ),
        "topic /slam/path, log time .*: the path is in 'map', but its pose 3 is in 'odom'": slam_path(
            S, mixed
        ),
        "/slam/path, pose 1: .* in 'map', got one in 'odom'; to use it, pass this name as parent": (
            slam_path(S, mixed[2:], frame="odom")
        ),
        "topic /slam/path: its last message has no poses": slam_path(S, []),
        "/slam/path, pose 3: its stamp is 0, which means that it is not set": slam_path(
            S, [*POSES[:2], unstamped[0]]
        ),
        "topic /slam/path, log time 1000000000 ns": Sent(S, "/slam/path", b"\0\1\0\0ab", LAST.msgtype),
    }
    for text, last in wrong.items():
        others = [slam_path(S, POSES, topic) for topic in ("/b", "/c")]
        with pytest.raises(bag.BagError, match=text):
            load(*others, last)
    with pytest.raises(
        FileNotFoundError, match="neither a file nor a topic of .*with poses are: /b, /c: '/slam"
    ):
        load(*others)
    with pytest.raises(
        bag.BagError, match="/slam/path, pose 1: none of its poses can be used: its stamp is 0"
    ):
        load(slam_path(S, unstamped), on_missing="skip")
    # Empty frames of poses are that of the path; a leading slash is that of ROS 1.
    empty = [posed(int(ns), 1.0, "", STAMPED, frame="") for ns in KEYFRAMES]
    assert_allclose(
        load(slam_path(S, empty, frame="/map")).lookup_matrix("map", "base", int(KEYFRAMES[1]))[0, 3], 1
    )


def check_topic(buffer, parent="map", moving="base"):
    got = buffer.lookup_matrices(parent, moving, KEYFRAMES)
    assert_allclose(got[:, 0, 3], X, rtol=0, atol=1e-9)
    assert_allclose(got[:, :2, 0], np.array([np.cos(X), np.sin(X)]).T, rtol=0, atol=1e-9)


@pytest.mark.parametrize("msgtype", [ODOMETRY, STAMPED, WITH_COVARIANCE, TRANSFORM])
@pytest.mark.parametrize("ros", [1, 2])
def test_each_message_of_a_topic_has_a_pose(tmp_path, msgtype, ros):
    poses = [posed(int(ns), float(i), "/pose", msgtype, ros=ros) for i, ns in enumerate(KEYFRAMES)]
    write = write_mcap if ros == 2 else write_ros1
    path = write(tmp_path / f"run.{'mcap' if ros == 2 else 'bag'}", with_paths(*poses))
    check_topic(bag.load(path, trajectory=replace(ON_TOPIC, path="/pose")))
    # Whatever the part that is loaded.
    part = bag.load(path, start=BEGIN_NS, end=BEGIN_NS + 30 * S, trajectory=replace(ON_TOPIC, path="/pose"))
    check_topic(part)


def test_poses_of_an_array_have_their_stamps_in_a_file(tmp_path):
    path = write_mcap(
        tmp_path / "run.mcap", with_paths(pose_array(BEGIN_NS, POSES[:2]), pose_array(BEGIN_NS + S, POSES))
    )
    times = tmp_path / "times.txt"
    times.write_text("timestamp [ns]\n" + "".join(f"{ns}\n" for ns in KEYFRAMES))
    array = replace(ON_TOPIC, path="/poses")
    check_topic(bag.load(path, trajectory=replace(array, times=times)))
    times.write_text("".join(f"{(ns - BEGIN_NS) / S:.9f}\n" for ns in KEYFRAMES))
    check_topic(bag.load(path, trajectory=replace(array, times=times, start=BEGIN_NS)))
    with pytest.raises(
        bag.BagError, match="topic /poses: poses of a PoseArray have no stamps: pass them as `times` or"
    ):
        bag.load(path, trajectory=array)
    times.write_text("100\n")
    with pytest.raises(
        bag.BagError, match="each of the 18 poses in .*run.mcap, topic /poses, got 1 in .*times.txt"
    ):
        bag.load(path, trajectory=replace(array, times=times))
    check_topic(bag.load(path, trajectory=replace(array, times=KEYFRAMES)))


def test_what_a_topic_cannot_be_is_refused(tmp_path):
    bad = posed(int(KEYFRAMES[1]), 1.0, "/bad", ODOMETRY)
    bad.content["pose"].pose.orientation.z = bad.content["pose"].pose.orientation.w = 0.0
    nan = posed(int(KEYFRAMES[1]), math.nan, "/nan", STAMPED)
    odometry = [posed(int(ns), 0.0, "/odom", ODOMETRY, child="imu") for ns in KEYFRAMES[:3]]
    sent = with_paths(LAST, bad, nan, *odometry)
    path = write_mcap(tmp_path / "run.mcap", sent, topics=[("/empty", STAMPED)])
    (tmp_path / "times.txt").write_text("1\n")
    wrong = {
        "topic /odom, message 1: .* of 'base', got one of 'imu'; to use it, pass this name as moving": {
            "path": "/odom"
        },
        "topic /bad, message 1: expected a rotation of length 1, got the length 0$": {"path": "/bad"},
        "topic /nan, message 1: expected a position of finite numbers, got .nan, 2.0, 3.0.$": {
            "path": "/nan"
        },
        "topic /tf: expected the type nav_msgs/msg/Path, .* or geometry_msgs/msg/PoseArray, got tf2_msgs": {
            "path": "/tf"
        },
        "topic /empty: it has no messages$": {"path": "/empty"},
        "topic /slam/path: the poses of a nav_msgs/msg/Path have stamps; `times` is not for them$": {
            "times": tmp_path / "times.txt"
        },
        "topic /slam/path: `columns` is for files": {"columns": "t x y z qx qy qz qw"},
        "topic /slam/path: `start` is for the stamps of files, which may count from a start$": {"start": 5},
    }
    for text, changed in wrong.items():
        with pytest.raises(bag.BagError, match=text):
            bag.load(path, trajectory=replace(ON_TOPIC, **changed))
    others = "whose topics with poses are: /bad, /empty, /nan, /odom, /slam/path: 'slam/path'"
    with pytest.raises(FileNotFoundError, match=f"neither a file nor a topic of .*run.mcap, {others}$"):
        bag.load(path, trajectory=replace(ON_TOPIC, path="slam/path"))


def test_topics_of_old_recordings_have_no_slash(tmp_path):
    path = write_ros1(tmp_path / "run.bag", with_paths(slam_path(BEGIN_NS, ROS_1_POSES, "slam/path", ros=1)))
    check_topic(bag.load(path, trajectory=replace(ON_TOPIC, path="slam/path")))


PREFIXED = {"/robot2/tf": "robot2/", "/robot2/tf_static": "robot2/", "/tf": ""}


@pytest.mark.parametrize("msgtype", [PATH, ODOMETRY, STAMPED])
@pytest.mark.parametrize("topic", ["/robot2/pose", "/robot2/slam/pose", "/elsewhere"])
def test_frames_of_poses_have_the_prefix_of_their_robot(tmp_path, msgtype, topic):
    poses = (
        [posed(int(ns), float(i), topic, msgtype) for i, ns in enumerate(KEYFRAMES)]
        if msgtype != PATH
        else []
    )
    sent = poses or [slam_path(BEGIN_NS, POSES, topic)]
    path = write_mcap(tmp_path / "run.mcap", [*drive(COUNT, prefix="/robot2"), *drive(3), *sent])
    own = bag.Trajectory(topic, "robot2/map", "robot2/odom", "robot2/base")
    if topic == "/elsewhere":
        with pytest.raises(bag.BagError, match="expected a pose in 'robot2/map', got one in 'map'"):
            bag.load(path, topics=PREFIXED, trajectory=own)
    topics = PREFIXED | {"/elsewhere": "robot2/"}
    check_topic(bag.load(path, topics=topics, trajectory=own), "robot2/map", "robot2/base")
    # A frame that robots share.
    world = replace(own, parent="map", child="robot2/map")
    check_topic(bag.load(path, topics=topics, trajectory=world), "map", "robot2/base")


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
    apart = "both stamps are 109.012345678 s, but the poses are 1 m and 0 degrees apart; on_missing="
    with pytest.raises(bag.BagError, match=f"optimized.tum, lines 20 and 21: {apart}"):
        bag.load(path, trajectory=optimized)
    with pytest.warns(
        UserWarning, match="2 of the 19 poses in .*, because others with the same stamp differ$"
    ):
        bag.load(path, trajectory=skipping)


def test_other_arguments_are_refused(path, tmp_path):
    for given in (b"optimized.tum", (np.zeros((1, 3)), [[0.0, 0.0, 0.0, 1.0]])):
        with pytest.raises(TypeError, match="path: expected a str, a path, or arrays with `times`, got "):
            bag.Trajectory(given, "map", "odom", "base")
    with pytest.raises(ValueError, match="columns: expected one column for qw, got none"):
        bag.Trajectory("a", "map", "odom", "base", columns="t x y z qx qy qz")
    with pytest.raises(ValueError, match="columns: not for poses with `times`"):
        bag.Trajectory("a", "map", "odom", "base", times="b", columns="t x y z qx qy qz qw")
    with pytest.raises(TypeError, match="trajectory: expected a Trajectory, got str"):
        bag.load(path, trajectory="optimized.tum")
    with pytest.raises(FileNotFoundError):
        bag.load(path, trajectory=bag.Trajectory(tmp_path / "none.tum", "map", "odom", "base"))
    with pytest.raises(
        TypeError, match=r"child: expected a str, the name of a frame, got PosixPath\('odom'\)"
    ):
        bag.Trajectory("map", "map", Path("odom"), "base")
