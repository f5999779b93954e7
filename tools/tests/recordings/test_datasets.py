# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses at the stamps of images: what a row says, and that many recordings are one table."""

import numpy as np
import pytest
from making_bags import (
    STAMPED,
    S,
    Sent,
    Tf,
    drive,
    posed,
    scan,
    slam_path,
    write_folder,
    write_mcap,
    write_split,
)
from robot_of_all_joints import ARM, NAMES, joint_state

from tf2_ros import InvalidArgumentException, LookupException
from tf2_ros_tools import bag
from tf2_ros_tools.recordings.datasets import find_recordings

FRAMES = ["camera", "lidar"]
TIMES = [99 * S, 100 * S, 100 * S + 30_000_000, 101 * S + 5, 101 * S + 900_000_000, 150 * S]


def write(path, extra=(), begin_ns=100 * S):
    """A drive of 20 samples from 100 s, and images at TIMES."""
    images = [scan(max(ns, 0), ns + begin_ns - 100 * S, "/images") for ns in TIMES]
    return write_mcap(path, [*drive(20, begin_ns=begin_ns), *images, *extra])


@pytest.fixture
def path(tmp_path):
    return write(tmp_path / "run.mcap")


def made(recordings, **how):
    return bag.dataset(recordings, FRAMES, at="/images", relative_to="map", **how)


def test_each_image_has_the_poses_at_its_stamp(path):
    data = made(path)
    facts = (len(data), data.frames, data.relative_to, data.files)
    assert facts == (6, ("camera", "lidar"), "map", (str(path),))
    assert data.stamps_ns.tolist() == TIMES
    buffer = bag.load(path)
    for i, frame in enumerate(FRAMES):
        translations, rotations = buffer.lookup_transforms("map", frame, TIMES, on_missing="nan")
        np.testing.assert_equal(data.poses[:, i], np.hstack([translations, rotations]))
    assert data.valid.tolist() == [[ok] * 2 for ok in (False, True, True, True, True, False)]
    # A sample is every 0.1 s, from 100 s to 101.9 s.
    np.testing.assert_equal(data.gaps[:, 0], [np.nan, 0.0, 0.1, 0.1, 0.0, np.nan])


def test_the_longest_gap_of_all_frames_between_counts(tmp_path):
    slow = [Sent(ns, "/tf", [Tf("base", "arm", ns)]) for ns in (100 * S, 101 * S + 500_000_000, 102 * S)]
    path = write(tmp_path / "run.mcap", slow)
    data = bag.dataset(path, ["arm", "base", "camera"], at="/images", relative_to="odom")
    np.testing.assert_equal(data.gaps[2], [1.5, 0.1, 0.1])
    np.testing.assert_equal(data.gaps[4], [0.5, 0.0, 0.0])
    fixed = bag.dataset(path, ["camera", "base"], at="/images", relative_to="base")
    assert fixed.valid.all() and not fixed.gaps.any()


def test_an_image_without_a_stamp_has_no_pose(tmp_path):
    stamps = [0, 100 * S, 0, 101 * S, 0]
    images = [scan(100 * S + i, ns, "/images") for i, ns in enumerate(stamps)]
    path = write_mcap(tmp_path / "run.mcap", [*drive(20), *images])
    data = bag.dataset(path, ["camera"], at="/images", relative_to="base")  # where it never moves
    assert data.stamps_ns.tolist() == [ns or -(2**63) for ns in stamps]
    assert data.valid[:, 0].tolist() == [False, True, False, True, False]
    np.testing.assert_equal(data.timestamps, [np.nan, 0.0, np.nan, 1.0, np.nan])
    assert np.isnan(data.poses[~data.valid]).all() and np.isnan(data.gaps[~data.valid]).all()


def test_an_image_whose_stamp_no_message_of_tf2_could_have_has_no_pose(tmp_path):
    """Nanoseconds beyond a second are added to the seconds."""
    images = [scan(100 * S + i, 100 * S, "/images") for i in range(2)]
    images[1].content["header"].stamp.sec, images[1].content["header"].stamp.nanosec = 2**31 - 1, S
    path = write_mcap(tmp_path / "run.mcap", [*drive(20), *images])
    for target in ("base", "map"):
        data = bag.dataset(path, ["camera"], at="/images", relative_to=target)
        assert data.stamps_ns.tolist() == [100 * S, 2**31 * S]
        assert data.valid[:, 0].tolist() == [True, False]
    only = write_mcap(tmp_path / "only.mcap", [*drive(20), images[1]])
    with pytest.raises(LookupException, match="any stamp of /images: the time 2147483648.0* s does not fit"):
        bag.dataset(only, ["camera"], at="/images", relative_to="base")


def test_a_recording_without_images_does_not_give_the_reason(tmp_path):
    none = write_mcap(tmp_path / "a.mcap", drive(20), topics=[("/images", scan(0, 0).msgtype)])
    late = write_mcap(tmp_path / "b.mcap", [*drive(20), scan(100 * S, 900 * S, "/images")])
    with pytest.raises(LookupException, match="any stamp of /images: Lookup would require extrapolation"):
        bag.dataset([none, late], ["camera"], at="/images", relative_to="map")


class TestTrajectory:
    """Two recordings with a path on a topic, which differ."""

    @pytest.fixture
    def runs(self, tmp_path):
        def with_path(x):
            return [slam_path(101 * S, [posed(ns, x, "", STAMPED) for ns in (100 * S, 101 * S)])]

        return [str(write(tmp_path / f"{x}.mcap", with_path(float(x)))) for x in (3, 4)]

    def test_a_path_on_a_topic_corrects_each_recording(self, runs):
        on_topic = bag.Trajectory("/slam/path", "map", "odom", "base")
        data = bag.dataset(runs, ["base"], at="/images", relative_to="map", trajectory=on_topic)
        at_keyframe = data.poses[data.stamps_ns == 100 * S, 0, 0]
        np.testing.assert_allclose(at_keyframe, [3.0, 4.0], rtol=0, atol=1e-9)

    def test_the_time_between_keyframes_is_not_a_gap_of_what_was_measured(self, tmp_path):
        keyframes = slam_path(101 * S, [posed(ns, 1.0, "", STAMPED) for ns in (100 * S, 101_900_000_000)])
        path = write(tmp_path / "run.mcap", [keyframes])
        sent = [one for one in drive(20) if not 101 * S <= one.log_ns < 101_500_000_000]
        images = [scan(ns, ns, "/images") for ns in TIMES]
        outage = write_mcap(tmp_path / "outage.mcap", [*sent, *images, keyframes])
        on_topic = bag.Trajectory("/slam/path", "map", "odom", "base")
        for recording, gap in ((path, 0.1), (outage, 0.6)):
            corrected, plain = made(recording, trajectory=on_topic), made(recording)
            np.testing.assert_equal(corrected.gaps, plain.gaps)
            np.testing.assert_allclose(corrected.gaps[3], gap)
            only = bag.dataset(
                recording, ["odom"], at="/images", relative_to="map", trajectory=on_topic
            ).gaps[1:5]
            assert not only.any()

    def test_poses_that_are_left_out_are_counted(self, runs, tmp_path):
        (tmp_path / "early.tum").write_text("99 9 0 0 0 0 0 1\n101 9 0 0 0 0 0 1\n")
        early = bag.Trajectory(tmp_path / "early.tum", "map", "odom", "base", on_missing="skip")
        text = "1 of the 2 poses in .*early.tum is left out, because base in odom is not known"
        with pytest.warns(UserWarning, match=f"4.mcap: {text}") as warned:
            made(runs[1], trajectory=early)
        assert [(len(warned), one.filename) for one in warned] == [(1, __file__)]


def test_rows_are_float32_unless_it_would_round_by_more_than_a_millimeter(path, tmp_path):
    assert {row["pose"].dtype for row in made(path)} == {np.dtype(np.float32)}
    for x, dtype in ((32_000.0, np.float32), (5_400_000.3, np.float64), (-5_400_000.3, np.float64)):
        utm = [Sent(100 * S, "/tf_static", [Tf("utm", "map", 0, (0.0, x, 0.0))])]
        data = bag.dataset(write(tmp_path / f"{x}.mcap", utm), FRAMES, at="/images", relative_to="utm")
        assert {row["pose"].dtype for row in data} == {np.dtype(dtype)}
        for row, pose in zip(data, data.poses, strict=True):
            np.testing.assert_allclose(row["pose"].astype(np.float64), pose, rtol=0, atol=1e-3)
        unanswered = data.where(~data.valid.any(axis=1))
        assert len(unanswered) == 2 and unanswered[0]["pose"].dtype == np.float32


def test_rows_can_be_chosen(path):
    data = made(path)
    good = data.where(data.valid.all(axis=1) & (data.gaps <= 0.05).all(axis=1))
    assert [row["frame_index"] for row in good] == [1, 4]
    assert good.files == data.files
    with pytest.raises(TypeError, match="to dtype\\('bool'\\)"):
        data.where([1] * 6)


class TestFinding:
    """Which recordings are meant."""

    @pytest.fixture
    def runs(self, tmp_path):
        """A folder with four good recordings, two of them with the same name."""
        at = tmp_path / "runs"
        for day in ("monday", "tuesday"):
            (at / day).mkdir(parents=True)
            write_mcap(at / day / "run.mcap", drive(40))
        write_folder(at / "monday" / "folder", drive(30), "sqlite3")
        write_split(at / "split", drive(30))
        return at

    def test_a_folder_is_searched_and_one_of_rosbag2_is_one_recording(self, runs):
        (runs / "notes.txt").write_text("nothing")
        (runs / "monday" / "metadata.yaml").write_text("of something else")
        found = ["monday/folder", "monday/run.mcap", "split", "tuesday/run.mcap"]
        assert find_recordings(str(runs)) == [str(runs / name) for name in found]
        assert find_recordings(runs / "split") == [str(runs / "split")]
        assert find_recordings(runs / "monday" / "run.mcap") == [str(runs / "monday" / "run.mcap")]
        compressed = (runs / "tuesday" / "run.mcap").rename(runs / "tuesday" / "run.mcap.zstd")
        assert find_recordings(runs / "tuesday") == find_recordings(compressed) == [str(compressed)]
        unfinished = compressed.rename(runs / "tuesday" / "run.bag.active")  # reported as failed
        assert find_recordings(runs / "tuesday") == [str(unfinished)]

    def test_paths_are_taken_as_they_are_and_each_once(self, runs):
        (runs / "link.mcap").symlink_to(runs / "monday" / "run.mcap")
        run = str(runs / "monday" / "run.mcap")
        gone = str(runs / "gone.mcap")
        assert find_recordings([run, runs / "link.mcap", gone]) == [run, gone]
        assert find_recordings([gone, runs / "tuesday"]) == [gone, str(runs / "tuesday" / "run.mcap")]
        [part] = (runs / "split").glob("*_0.mcap")
        assert find_recordings([part, runs / "split"]) == [str(runs / "split")]
        (runs / "empty").mkdir()
        for nothing in (runs / "empty", [runs / "empty"], []):
            with pytest.raises(FileNotFoundError):
                find_recordings(nothing)


class TestManyRecordings:
    @pytest.fixture
    def runs(self, tmp_path):
        runs = tmp_path / "runs"
        runs.mkdir()
        for i in range(3):
            write(runs / f"run{i}.mcap", begin_ns=(100 + i) * S)
        (runs / "broken.mcap").write_bytes(b"nothing")
        return runs

    def test_they_are_one_table(self, runs):
        data = made(runs)
        assert data.files == tuple(str(runs / f"run{i}.mcap") for i in range(3))
        assert list(data.failed) == [str(runs / "broken.mcap")]
        assert data.episodes.tolist() == np.repeat(range(3), 6).tolist()
        assert data.indices.tolist() == [*range(6)] * 3
        assert repr(data) == "<tf2_ros_tools.bag.Dataset: 18 rows of 2 frames in 3 recordings>"
        for i in range(3):
            alone = made(data.files[i])
            mine = data.where(data.episodes == i)
            for name in ("stamps_ns", "timestamps", "poses", "valid", "gaps"):
                np.testing.assert_equal(getattr(mine, name), getattr(alone, name))

    def test_a_list_keeps_its_order(self, runs):
        passed = [str(runs / f"run{i}.mcap") for i in (2, 0, 1)]
        for listed in (passed, iter(passed), [*passed, passed[0]]):  # each once
            data = made(listed)
            assert data.files == tuple(passed)
            assert data.stamps_ns[[0, 6, 12]].tolist() == [TIMES[0] + i * S for i in (2, 0, 1)]
        mixed = made([passed[1], str(runs)])
        assert mixed.files == tuple(str(runs / f"run{i}.mcap") for i in range(3))

    def test_the_same_robot_moves_in_each(self, tmp_path):
        runs = tmp_path / "runs"
        runs.mkdir()
        for i in range(2):
            states = [joint_state(ns, NAMES, [0.1 * i, 0.2, 0.3]) for ns in TIMES]
            write(runs / f"run{i}.mcap", states)
        how = {"at": "/images", "relative_to": "base", "urdf": ARM}
        data = bag.dataset(runs, ["thumb"], **how)
        np.testing.assert_allclose(data.valid, True)
        assert not (data.poses[:6] == data.poses[6:]).all()

    def test_none_that_can_be_read_is_an_error(self, runs, tmp_path):
        with pytest.raises(bag.BagError, match="broken.mcap is not a recording: "):
            made(runs / "broken.mcap")
        with pytest.raises(bag.BagError, match="none: the recording does not exist"):
            made(tmp_path / "none")

    def test_a_name_cannot_steer_the_terminal_that_shows_the_reasons(self, runs):
        (runs / "x\x1b[2J.mcap").write_bytes(b"nothing")
        reasons = made(runs).failed.values()
        assert len(reasons) == 2 and all(map(str.isprintable, reasons))


@pytest.mark.long("needs pyarrow")
def test_parquet_has_a_column_for_each_number(path, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    data = made(path)
    data.save(tmp_path / "data.parquet")
    columns = parquet.read_table(tmp_path / "data.parquet").to_pydict()
    assert list(columns)[:5] == ["file", "episode_index", "frame_index", "timestamp", "stamp_ns"]
    parts = ("x", "y", "z", "qx", "qy", "qz", "qw", "valid", "gap")
    assert list(columns)[5:] == [f"{frame}.{part}" for frame in FRAMES for part in parts]
    assert set(columns["file"]) == {str(path)}
    np.testing.assert_equal(columns["lidar.y"], data.poses[:, 1, 1])
    np.testing.assert_equal(columns["camera.gap"], data.gaps[:, 0])


@pytest.mark.parametrize(
    ("frames", "how", "error", "said"),
    [
        ("camera", {}, TypeError, r"frames: expected a list of names, got a str: use \['camera'\]"),
        (["camera", "camera"], {}, ValueError, "frames: expected one or more different names, got "),
        (["camera", "camra"], {}, LookupException, "camra"),
        (["camera"], {"at": "/image"}, bag.BagError, "topic /image: this topic does not exist; the topics"),
        (["camera"], {"relative_to": "mapp"}, LookupException, "mapp"),
        ([], {}, ValueError, r"frames: expected one or more different names, got \[\]"),
        (["camera", "/lidar"], {}, InvalidArgumentException, "frame_ids cannot start with a '/'"),
        (["camera"], {"topics": []}, ValueError, "topics: expected at least one topic, got none"),
    ],
)
def test_what_cannot_be_asked_is_told_in_one_sentence(path, frames, how, error, said):
    with pytest.raises(error, match=said):
        bag.dataset(path, frames, **{"at": "/images", "relative_to": "map", **how})
