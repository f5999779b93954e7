# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recorded transforms of Foxglove, in protobuf and in JSON."""

import re

import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from making_bags import S, Sent, Tf, drive, write_foxglove
from times_and_transforms import about_z

from tf2_ros_tools import bag


def test_a_single_transform_may_lack_a_rotation_and_be_before_1970(tmp_path):
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
def test_a_malformed_message_is_named(content, said, tmp_path):
    path = write_foxglove(tmp_path / "run.mcap", [*drive(), Sent(5, "/tf", content)])
    where = f"{path}, topic /tf, log time 5 ns: not a foxglove.FrameTransforms: "
    with pytest.raises(bag.BagError, match=f"^{re.escape(where)}.*{said}"):
        bag.load(path)


def test_other_topics_and_encodings_are_named(tmp_path):
    path = write_foxglove(tmp_path / "run.mcap", drive(prefix="/one"))
    others = "its topics with transforms: /one/tf, /one/tf_static: choose from these"
    with pytest.raises(bag.BagError, match=others):
        bag.load(path)
    write_foxglove(path, [Sent(1, "/tf", b"")], encoding="flatbuffer")
    with pytest.raises(bag.BagError, match="topic /tf: expected the encoding protobuf or json, got flat"):
        bag.load(path)


@pytest.mark.parametrize("profile", ["", "ros2"])
def test_single_transforms_in_json(profile, tmp_path):
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
def test_malformed_json_is_named(content, said, tmp_path):
    messages = [*drive(), Sent(5, "/tf", content)]
    path = write_foxglove(tmp_path / "run.mcap", messages, encoding="json")
    where = f"{path}, topic /tf, log time 5 ns: not a foxglove.FrameTransforms: "
    for read in (bag.load, lambda path: [*bag.transforms(path)]):
        with pytest.raises(bag.BagError, match=f"^{re.escape(where)}.*{said}"):
            read(path)
