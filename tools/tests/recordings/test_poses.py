# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recorded poses as transforms."""

import re

import numpy as np
import pytest
from making_bags import (
    FORMATS,
    ODOMETRY,
    STAMPED,
    STAMPS,
    TRANSFORM,
    WITH_COVARIANCE,
    Sent,
    drive,
    posed,
    series,
    write_mcap,
)
from times_and_transforms import about_z

from tf2_ros_tools import bag
from tf2_ros_tools.diagnosis.texts import line_of
from tf2_ros_tools.recordings.bag_loader import read_contents, wanted
from tf2_ros_tools.recordings.report import report


def check(buffer, target, source):
    translations, rotations = buffer.lookup_transforms(target, source, STAMPS)
    np.testing.assert_allclose(translations, [(i / 10, 2, 3) for i in range(20)], atol=1e-15)
    np.testing.assert_allclose(rotations, [about_z(i / 10) for i in range(20)], atol=1e-15)


@pytest.mark.parametrize("msgtype", [ODOMETRY, STAMPED, WITH_COVARIANCE, TRANSFORM])
@pytest.mark.parametrize("form", ["mcap", "folder-sqlite3", "ros1", "ros1-mcap"])
def test_each_type_is_a_transform_between_the_given_frames(msgtype, form, tmp_path):
    messages = series("/pose", msgtype, ros=1 if form.startswith("ros1") else 2)
    path = FORMATS[form](tmp_path, messages)
    check(bag.load(path, poses={"/pose": ("world", "gps")}), "world", "gps")


@pytest.mark.parametrize("msgtype", [ODOMETRY, TRANSFORM])
def test_some_messages_name_their_frames(msgtype, tmp_path):
    path = write_mcap(tmp_path / "run.mcap", [*drive(), *series("/odom", msgtype, frame="o", child="/b")])
    buffer = bag.load(path, poses={"/odom": None})
    check(buffer, "o", "b")
    assert buffer.parent("odom") == "map"  # of /tf
    assert set(read_contents(path, wanted(poses={"/odom": None})).publishers) == {
        "/tf",
        "/tf_static",
        "/odom",
    }


@pytest.mark.parametrize("msgtype", [ODOMETRY, TRANSFORM])
def test_the_names_in_messages_get_the_prefix_of_their_robot(msgtype, tmp_path):
    sent = [*drive(prefix="/a"), *series("/a/slam/odom", msgtype, frame="/o", child="b")]
    path = write_mcap(tmp_path / "run.mcap", sent)
    topics = {"/a/tf": "a/", "/a/tf_static": "a/"}
    check(bag.load(path, topics=topics, poses={"/a/slam/odom": None}), "a/o", "a/b")
    check(bag.load(path, topics=topics, poses={"/a/slam/odom": ("w", "g")}), "w", "g")  # as they are given
    others = {"x/o": {"/a/slam/odom": "x/"}, "o": {"/a/slam/tf": ""}}
    others["o"] |= {"/a/tf2": "z/"}  # which of both is not known
    # Several topics of one namespace; and the name of another namespace begins in the same way.
    others["a/o"] = {"/a/tf2": "a/", "/a/sl/tf": "x/"}
    for parent, more in others.items():
        buffer = bag.load(path, topics=topics | more, poses={"/a/slam/odom": None})
        check(buffer, parent, f"{parent[:-1]}b")
    check(bag.load(path, topics={"/a/tf_static": "a/"}, poses={"/a/slam/odom": None}), "o", "b")


def test_several_topics_times_and_frames_that_change(tmp_path):
    messages = [*series("/odom", ODOMETRY), *series("/gps", STAMPED)]
    messages += series("/odom", ODOMETRY, child="b")
    path = write_mcap(tmp_path / "run.mcap", messages, chunk_size=1 << 20)
    both = {"/odom": None, "/gps": ("map", "gps"), "/lost": ("map", "x")}
    for child in ("base", "gps", "b"):
        check(bag.load(path, poses=both), "map", child)
    buffer = bag.load(path, poses=both, start=STAMPS[5], end=STAMPS[9])
    assert {one.count for one in buffer.frames().values() if one.parent} == {5}


@pytest.mark.parametrize(
    ("poses", "error", "said"),
    [
        (
            {"/pose": None},
            bag.BagError,
            "run.mcap, topic /pose: a geometry_msgs/msg/PoseStamped has no child frame; "
            r'pass the frames, as in poses={"/gps/pose": \("map", "gps"\)} or --poses /gps/pose=map,gps$',
        ),
        (
            {"/tf": ("a", "b")},
            bag.BagError,
            "run.mcap, topic /tf: expected the type .*, got tf2_msgs/msg/TFMessage",
        ),
        ({"/odom": "gps"}, TypeError, r"poses: expected \(parent, child\) or None for /odom"),
        ({"/odom": ("a",)}, TypeError, "poses: expected "),
        ({"/bad": None}, bag.BagError, "run.mcap, topic /bad, log time 5 ns: "),
        ({"/odom": ("a\0b", "c")}, ValueError, "^poses: a frame name must not contain a NUL character"),
    ],
)
def test_what_does_not_fit_is_told_in_one_sentence(poses, error, said, tmp_path):
    broken = Sent(5, "/bad", b"\0\1\0\0" + bytes(30), ODOMETRY)
    path = write_mcap(tmp_path / "run.mcap", [broken, *drive(), *series("/pose", STAMPED)])
    with pytest.raises(error, match=said):
        bag.load(path, poses=poses)


@pytest.mark.parametrize("msgtype", [ODOMETRY, STAMPED, WITH_COVARIANCE, TRANSFORM])
def test_an_error_says_which_option_reads_a_topic(msgtype, tmp_path):
    path = write_mcap(tmp_path / "run.mcap", [*series("/one", msgtype), *series("/two", msgtype)])
    advice = "; `poses` or `--poses` reads the poses on /one, /two$"
    with pytest.raises(bag.BagError, match=f"its topics with transforms: none{advice}"):
        bag.load(path)
    of_type = f"topic /one: expected the type tf2_msgs/msg/TFMessage, got {msgtype}"
    with pytest.raises(bag.BagError, match=f"{of_type}; `poses` or `--poses` reads it$"):
        bag.load(path, topics=["/one"])


def test_a_name_of_a_recorded_pose_ends_at_a_nul(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", series("/odom", ODOMETRY, frame="o\0m", child="b\0\0"))
    check(bag.load(path, poses={"/odom": None}), "o", "b")


@pytest.mark.parametrize("lacks", ["child", "frame"])
@pytest.mark.parametrize("msgtype", [ODOMETRY, TRANSFORM])
def test_messages_without_a_name_of_a_frame_are_left_out(msgtype, lacks, tmp_path):
    named, unnamed = series("/odom", msgtype), series("/odom", msgtype, **{lacks: ""})
    path = write_mcap(tmp_path / "run.mcap", [*named, *unnamed])
    field = {"child": "child_frame_id", "frame": "frame_id"}[lacks]
    said = f"20 messages on /odom are left out: {field} is not set"
    with pytest.warns(UserWarning, match=f"run.mcap: {said}$"):
        check(bag.load(path, poses={"/odom": None}), "map", "base")
    with pytest.warns(UserWarning, match=f"run.mcap: {said}$"):
        bag.dataset(path, ["base"], at="/odom", relative_to="map", poses={"/odom": None})
    found = report(read_contents(path, wanted(poses={"/odom": None}))).findings
    assert [line_of(one) for one in found] == [f"malformed: {said}"]

    write_mcap(path, unnamed)
    advice = re.escape('pass the frames, as in poses={"/gps/pose": ("map", "gps")} or --poses')
    for name in (bag.load, lambda path, poses: read_contents(path, wanted(poses=poses))):
        with pytest.raises(bag.BagError, match=f"topic /odom: in its messages, {field} is not set; {advice}"):
            name(path, poses={"/odom": None})
    check(bag.load(path, poses={"/odom": ("map", "base")}), "map", "base")


@pytest.mark.parametrize("form", ["mcap", "ros1"])
def test_poses_whose_stamps_were_never_set_are_a_warning(form, tmp_path):
    ros = 1 if form == "ros1" else 2
    unset = [posed(0, i / 10, "/pose", STAMPED, ros=ros)._replace(log_ns=ns) for i, ns in enumerate(STAMPS)]
    path, poses = FORMATS[form](tmp_path, unset), {"/pose": ("map", "car")}
    with pytest.warns(UserWarning, match=f"{path.name}: all stamps of car are 0, because "):
        bag.load(path, poses=poses)
