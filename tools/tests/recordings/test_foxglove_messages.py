# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recorded transforms of Foxglove."""

import re

import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from making_bags import SCAN, S, Sent, Tf, drive, write_foxglove

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
    write_foxglove(path, [Sent(1, "/tf", b"{}"), Sent(1, "/scan", b"{}", SCAN)], encoding="json")
    said = "expected the encoding protobuf, in which Foxglove's SDK writes this type, got json$"
    with pytest.raises(bag.BagError, match=f"topic /tf: {said}"):
        bag.load(path)
    with pytest.raises(bag.BagError, match=f"topic /scan: {said}"):
        bag.stamps(path, "/scan")
