# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recorded poses, and Foxglove's transforms, as transforms."""

import re

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from making_bags import (
    FORMATS,
    ODOMETRY,
    STAMPED,
    STAMPS,
    TF,
    TRANSFORM,
    WITH_COVARIANCE,
    S,
    Sent,
    Tf,
    drive,
    posed,
    raw,
    series,
    store,
    write_folder,
    write_foxglove,
    write_mcap,
)
from making_objects import about_z
from mcap.writer import Writer
from robot_of_all_joints import ARM

from tf2_ros_tools import bag
from tf2_ros_tools.common.program import RunError
from tf2_ros_tools.diagnosis.texts import line_of
from tf2_ros_tools.programs.tf2_bag import PARSER
from tf2_ros_tools.programs.tf2_bag import bag as tf2_bag
from tf2_ros_tools.recordings.bag_loader import hear, wanted
from tf2_ros_tools.recordings.report import report

pytestmark = pytest.mark.ours


def check(buffer, target, source):
    translations, rotations = buffer.lookup_transforms(target, source, STAMPS)
    np.testing.assert_allclose(translations, [(i / 10, 2, 3) for i in range(20)], atol=1e-15)
    np.testing.assert_allclose(rotations, [about_z(i / 10) for i in range(20)], atol=1e-15)


class TestPoses:
    @pytest.mark.parametrize("msgtype", [ODOMETRY, STAMPED, WITH_COVARIANCE, TRANSFORM])
    @pytest.mark.parametrize("form", ["mcap", "folder-sqlite3", "ros1", "ros1-mcap"])
    def test_each_type_is_a_transform_between_the_given_frames(self, msgtype, form, tmp_path):
        messages = series("/pose", msgtype, ros=1 if form.startswith("ros1") else 2)
        path = FORMATS[form](tmp_path, messages)
        check(bag.load(path, poses={"/pose": ("world", "gps")}), "world", "gps")

    @pytest.mark.parametrize("msgtype", [ODOMETRY, TRANSFORM])
    def test_some_messages_name_their_frames(self, msgtype, tmp_path):
        path = write_mcap(tmp_path / "run.mcap", [*drive(), *series("/odom", msgtype, frame="o", child="/b")])
        buffer = bag.load(path, poses={"/odom": None})
        check(buffer, "o", "b")
        assert buffer.parent("odom") == "map"  # of /tf
        assert set(hear(path, wanted(poses={"/odom": None})).publishers) == {"/tf", "/tf_static", "/odom"}

    def test_several_topics_times_and_frames_that_change(self, tmp_path):
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
    def test_what_does_not_fit_is_told_in_one_sentence(self, poses, error, said, tmp_path):
        broken = Sent(5, "/bad", b"\0\1\0\0" + bytes(30), ODOMETRY)
        path = write_mcap(tmp_path / "run.mcap", [broken, *drive(), *series("/pose", STAMPED)])
        with pytest.raises(error, match=said):
            bag.load(path, poses=poses)

    @pytest.mark.parametrize("msgtype", [ODOMETRY, STAMPED, WITH_COVARIANCE, TRANSFORM])
    def test_an_error_says_which_option_reads_a_topic(self, msgtype, tmp_path):
        path = write_mcap(tmp_path / "run.mcap", [*series("/one", msgtype), *series("/two", msgtype)])
        advice = "; `poses` or `--poses` reads the poses on /one, /two$"
        with pytest.raises(bag.BagError, match=f"its topics with transforms: none{advice}"):
            bag.load(path)
        of_type = f"topic /one: expected the type tf2_msgs/msg/TFMessage, got {msgtype}"
        with pytest.raises(bag.BagError, match=f"{of_type}; `poses` or `--poses` reads it$"):
            bag.load(path, topics=["/one"])

    @pytest.mark.parametrize("form", [*FORMATS, "protobuf", "json"])
    def test_a_recorded_name_ends_at_a_nul(self, form, tmp_path):
        """As a received one does; some drivers in C++ send such names."""
        tf = [Sent(S, "/tf", [Tf("map\0\0", "base\0lidar", S, (1, 2, 3))])]
        if form in FORMATS:
            buffer = bag.load(FORMATS[form](tmp_path, tf))
        else:
            buffer = bag.load(write_foxglove(tmp_path / "run.mcap", tf, form))
        assert set(buffer.frames()) == {"map", "base"}

    def test_a_name_of_a_recorded_pose_ends_at_a_nul(self, tmp_path):
        path = write_mcap(tmp_path / "run.mcap", series("/odom", ODOMETRY, frame="o\0m", child="b\0\0"))
        check(bag.load(path, poses={"/odom": None}), "o", "b")

    @pytest.mark.parametrize("lacks", ["child", "frame"])
    @pytest.mark.parametrize("msgtype", [ODOMETRY, TRANSFORM])
    def test_messages_without_a_name_of_a_frame_are_left_out(self, msgtype, lacks, tmp_path):
        named, unnamed = series("/odom", msgtype), series("/odom", msgtype, **{lacks: ""})
        path = write_mcap(tmp_path / "run.mcap", [*named, *unnamed])
        field = {"child": "child_frame_id", "frame": "frame_id"}[lacks]
        said = f"20 messages on /odom are left out: {field} is not set"
        with pytest.warns(UserWarning, match=f"run.mcap: {said}$"):
            check(bag.load(path, poses={"/odom": None}), "map", "base")
        found = report(hear(path, wanted(poses={"/odom": None}))).findings
        assert [line_of(one) for one in found] == [f"malformed: {said}"]

        write_mcap(path, unnamed)
        advice = re.escape('pass the frames, as in poses={"/gps/pose": ("map", "gps")} or --poses')
        for name in (bag.load, lambda path, poses: hear(path, wanted(poses=poses))):
            with pytest.raises(
                bag.BagError, match=f"topic /odom: in its messages, {field} is not set; {advice}"
            ):
                name(path, poses={"/odom": None})
        check(bag.load(path, poses={"/odom": ("map", "base")}), "map", "base")

    @pytest.mark.parametrize("form", ["mcap", "ros1"])
    def test_poses_whose_stamps_were_never_set_are_a_warning(self, form, tmp_path):
        ros = 1 if form == "ros1" else 2
        unset = [
            posed(0, i / 10, "/pose", STAMPED, ros=ros)._replace(log_ns=ns) for i, ns in enumerate(STAMPS)
        ]
        path, poses = FORMATS[form](tmp_path, unset), {"/pose": ("map", "car")}
        for options in ({}, {"cache": tmp_path}, {"cache": tmp_path}):
            with pytest.warns(UserWarning, match=f"{path.name}: all stamps of car are 0, because "):
                bag.load(path, poses=poses, **options)


class TestAdvice:
    """What `tf2_bag` says where a frame may be missing because its topic is."""

    @pytest.mark.parametrize(
        ("messages", "options", "said"),
        [
            (
                [one for one in drive() if one.topic == "/tf"],
                [],
                "no static transforms were recorded: they are sent once, .*; `urdf` or `--urdf` computes",
            ),
            (
                [one._replace(topic=f"/a{one.topic}") if one.topic != "/tf" else one for one in drive()],
                [],
                "no static transforms are read: `topics` or `--topic` reads those on /a/tf_static",
            ),
            ([*drive(), *series("/odom", ODOMETRY)], ["--poses", "/empty"], "topic /empty has no messages"),
            (
                [*drive(), *series("/odom", ODOMETRY)],
                ["--poses", "/gone=map,gps"],
                "there is no topic /gone; the topics of its type are /empty, /odom",
            ),
            (
                [*drive(), *series("/odom", ODOMETRY)],
                ["--urdf", "/states=arm.urdf"],
                "there is no topic /states; the topics of its type are none",
            ),
        ],
    )
    def test_is_given_with_an_unknown_frame(self, messages, options, said, tmp_path, capsys, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "arm.urdf").write_text(ARM)
        path = write_mcap(tmp_path / "run.mcap", messages, topics=[("/empty", ODOMETRY)])
        with pytest.raises(RunError, match=f'"mast" passed to lookupTransform .* does not exist.*; {said}'):
            tf2_bag(PARSER.read(["tf2_bag", "lookup", str(path), "map", "mast", *options]))
        assert tf2_bag(PARSER.read(["tf2_bag", "info", str(path), *options])) == 0
        assert re.search(f"^{said}", capsys.readouterr().out, re.MULTILINE)

    def test_is_given_where_there_is_no_transform_at_all(self, tmp_path, capsys):
        path = write_mcap(tmp_path / "run.mcap", [], topics=[("/empty", ODOMETRY)])
        assert tf2_bag(PARSER.read(["tf2_bag", "check", str(path), "--poses", "/empty"])) == 1
        assert "nothing: no transform was received (topic /empty has no messages)" in capsys.readouterr().out


# Foxglove.


class TestFoxglove:
    def test_a_single_transform_may_lack_a_rotation_and_be_before_1970(self, tmp_path):
        sent = FrameTransform(parent_frame_id="a", child_frame_id="b", timestamp={"seconds": -1, "nanos": 5})
        messages = [Sent(1, "/tf", sent.SerializeToString(), "FrameTransform")]
        [(_, _, bare)] = bag.transforms(write_foxglove(tmp_path / "run.mcap", messages))
        assert (bare.header.stamp.sec, bare.header.stamp.nanosec) == (-1, 5)
        assert (bare.transform.translation.x, bare.transform.rotation.w) == (0.0, 1.0)

    @pytest.mark.parametrize(
        ("content", "said"),
        [
            (b"\x0a\x7f", "Error parsing message"),
            ([Tf("a", "b", S << 40)], "does not fit into 32 bits of seconds"),
        ],
    )
    def test_a_malformed_message_is_named(self, content, said, tmp_path):
        path = write_foxglove(tmp_path / "run.mcap", [*drive(), Sent(5, "/tf", content)])
        where = f"{path}, topic /tf, log time 5 ns: not a foxglove.FrameTransforms: "
        with pytest.raises(bag.BagError, match=f"^{re.escape(where)}.*{said}"):
            bag.load(path)

    @pytest.mark.parametrize("schema", [b"\xb2\xff\x00", b"\x0a\x03abc", b"# caf\xe9\nint32 x\n"])
    @pytest.mark.parametrize("encoding", ["protobuf", "flatbuffer", "ros2msg"])
    @pytest.mark.parametrize("profile", ["", "ros2"])
    def test_other_topics_may_have_any_schema(self, schema, encoding, profile, tmp_path):
        path = tmp_path / "run.mcap"
        with open(path, "wb") as file:
            writer = Writer(file)
            writer.start(profile)
            other = writer.register_channel(
                "/other", "cdr", writer.register_schema("x/msg/Y", encoding, schema)
            )
            writer.add_message(other, 1, schema, 1)
            text, _ = store().generate_msgdef(TF, ros_version=2)
            tf = writer.register_channel("/tf", "cdr", writer.register_schema(TF, "ros2msg", text.encode()))
            writer.add_message(tf, S, raw(Sent(S, "/tf", [Tf("map", "base", S, (1, 2, 3))])), S)
            writer.finish()
        [(_, _, found)] = bag.transforms(path)
        assert found.transform.translation.z == 3.0

    def test_a_folder_of_several_encodings_is_read_file_by_file(self, tmp_path):
        path = write_folder(tmp_path / "run", drive())
        metadata = path / "metadata.yaml"
        metadata.write_text(
            metadata.read_text().replace("serialization_format: cdr", "serialization_format: json", 1)
        )
        text = "a topic is not in CDR, or .* load its files one by one: run.mcap$"
        with pytest.raises(bag.BagError, match=text):
            bag.load(path)
        assert bag.load(path / "run.mcap").can_transform("map", "base", 101 * S)

    def test_other_topics_and_encodings_are_named(self, tmp_path):
        path = write_foxglove(tmp_path / "run.mcap", drive(prefix="/one"))
        others = "its topics with transforms: /one/tf, /one/tf_static: choose from these"
        with pytest.raises(bag.BagError, match=others):
            bag.load(path)
        write_foxglove(path, [Sent(1, "/tf", b"")], encoding="flatbuffer")
        with pytest.raises(bag.BagError, match="topic /tf: expected the encoding protobuf or json, got flat"):
            bag.load(path)

    @pytest.mark.parametrize("profile", ["", "ros2"])
    def test_single_transforms_in_json(self, profile, tmp_path):
        whole = Sent(2, "/tf", [Tf("a", "b", 2 * S + 7, (1, 2.5, 3), about_z(0.5))], "FrameTransform")
        path = write_foxglove(tmp_path / "run.mcap", [whole], "json", profile=profile)
        [(_, _, first)] = bag.transforms(path)
        assert (first.header.frame_id, first.child_frame_id, first.header.stamp.nanosec) == ("a", "b", 7)
        assert (first.transform.translation.y, first.transform.rotation.w) == (2.5, about_z(0.5)[3])
        assert bag.stamps(path, "/tf").tolist() == [2 * S + 7]

    @pytest.mark.parametrize(
        ("content", "said"),
        [
            (b"", "Expecting value"),
            (b"\xff\xfe", "codec can't decode"),
            (b"[" * 10**5, "recursion"),
            (b"[]", "has no attribute"),
            (
                b'{"parent_frame_id": "\\ud800", "child_frame_id": "b", "timestamp": {"sec": 1, "nsec": 0},'
                b' "translation": {"x": 1, "y": 2, "z": 3}, "rotation": {"x": 0, "y": 0, "z": 0, "w": 1}}',
                "surrogates not allowed",
            ),
            *[
                (
                    b'{"parent_frame_id": "a", "child_frame_id": "b", "timestamp": {"sec": 1, "nsec": 0}%s}'
                    % pose,
                    f"it has no {lacks}",
                )
                for pose, lacks in (
                    (b"", "translation"),
                    (b', "transform": {"translation": {"x": 1, "y": 2, "z": 3}}', "translation"),
                    (b', "translation": {"x": 1, "y": 2, "z": 3}', "rotation"),
                    (b', "translation": {"x": 1, "y": 2, "z": 3}, "rotation": {"x": 0, "y": 0, "z": 0}', "w"),
                )
            ],
            (b'{"transforms": {}}', "not iterable"),
            (b'{"transforms": [1]}', "has no attribute"),
            (b'{"parent_frame_id": 3, "child_frame_id": "b"}', "has no attribute 'partition'"),
            (
                b'{"parent_frame_id": "a", "child_frame_id": "b", "timestamp": {"sec": 1.5, "nsec": 0}}',
                "unsupported operand",
            ),
            (
                b'{"parent_frame_id": "a", "child_frame_id": "b", "timestamp": {"sec": %d, "nsec": 0}}'
                % (1 << 40),
                "does not fit into 32 bits of seconds",
            ),
            (
                b'{"parent_frame_id": "a", "child_frame_id": "b", "timestamp": {"sec": 1, "nsec": 0},'
                b' "translation": {"x": 1, "y": "b", "z": 3}, "rotation": {"x": 0, "y": 0, "z": 0, "w": 1}}',
                "could not convert string to float",
            ),
        ],
    )
    def test_malformed_json_is_named(self, content, said, tmp_path):
        messages = [*drive(), Sent(5, "/tf", content)]
        path = write_foxglove(tmp_path / "run.mcap", messages, encoding="json")
        where = f"{path}, topic /tf, log time 5 ns: not a foxglove.FrameTransforms: "
        for read in (bag.load, lambda path: [*bag.transforms(path)]):
            with pytest.raises(bag.BagError, match=f"^{re.escape(where)}.*{said}"):
                read(path)
