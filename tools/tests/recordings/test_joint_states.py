# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recorded joint states as transforms of a URDF's links."""

import re
import warnings

import numpy as np
import pytest
from making_bags import FORMATS, S, Sent, Tf, drive, raw, write_mcap
from robot_of_all_joints import (
    ARM,
    FIXED,
    FRAMES,
    JOINT_STATE,
    NAMES,
    description,
    expected,
    joint_state,
    random_states,
)
from urdfs_of_three_links import AB, BC, joint, robot_of

from tf2_ros.numpy import to_matrix
from tf2_ros_tools import bag, urdf
from tf2_ros_tools.diagnosis.texts import line_of
from tf2_ros_tools.recordings.bag_loader import read_contents, wanted
from tf2_ros_tools.recordings.report import report


def states(count=40, **how):
    """Joint states at 10 Hz from 100 s, and their stamps and positions."""
    values, stamps = random_states(count), [100 * S + i * S // 10 for i in range(count)]
    return (
        [joint_state(*one, **how) for one in zip(stamps, [NAMES] * count, values, strict=True)],
        stamps,
        values,
    )


def check(buffer, stamps, values, children=FRAMES, prefix=""):
    found = {
        child: to_matrix(buffer.lookup_transforms(buffer.parent(prefix + child), prefix + child, stamps))
        for child in children
    }
    for n, row in enumerate(values):
        wanted = expected(*row)
        for child in children:
            assert buffer.parent(prefix + child) == prefix + wanted[child][0]
            np.testing.assert_allclose(found[child][n], wanted[child][1], atol=1e-12)


COMPUTED = (
    "; its topics with transforms: none; `urdf` or `--urdf` computes them from the joint states on"
    " /joint_states, /robot/joint_states"
)


@pytest.mark.parametrize("form", ["folder-sqlite3", "mcap", "ros1"])
def test_an_arm_without_tf_has_its_links(form, tmp_path):
    messages, stamps, values = states(ros=1 if form == "ros1" else 2)
    buffer = bag.load(FORMATS[form](tmp_path, messages), urdf=ARM)
    check(buffer, stamps, values)
    camera = to_matrix(buffer.lookup_transform("shoulder", "camera", 0))
    np.testing.assert_allclose(camera, FIXED["camera"][1], atol=1e-12)
    assert buffer.frames()["camera"].static
    assert "broadcaster: '/joint_states'" in buffer.all_frames_as_yaml()


def test_more_states_than_a_batch_holds_are_in_order(tmp_path, monkeypatch):
    monkeypatch.setattr("tf2_ros_tools.recordings.joints_and_poses.BATCH", 7)
    messages, stamps, values = states(100)
    path = write_mcap(tmp_path / "run.mcap", messages)
    check(bag.load(path, urdf=ARM), stamps, values)
    heard = read_contents(path, wanted(urdf=ARM))
    moving = heard.records[heard.records["static"] == 0]
    assert moving["stamp_ns"].tolist() == np.repeat(stamps, len(FRAMES)).tolist()
    assert set(heard.publishers) == {"urdf", "/joint_states"}


def test_several_robots_have_their_own_topics_and_prefixes(tmp_path):
    left, stamps, values = states(topic="/left/joint_states")
    right, _, _ = states(20, topic="/right/joint_states")
    path = write_mcap(tmp_path / "run.mcap", [description(topic="/right/robot_description"), *left, *right])
    robots = {"/left/joint_states": urdf.load(ARM, prefix="left/"), "/right/joint_states": True}
    buffer = bag.load(path, urdf=robots)
    check(buffer, stamps, values, prefix="left/")
    check(buffer, stamps[:20], values[:20])


def test_recorded_transforms_come_before_computed_ones(tmp_path):
    messages, stamps, values = states()
    tf = [Sent(ns, "/tf", [Tf("base", "shoulder", ns, (7.0, 0.0, 0.0))]) for ns in stamps]
    static = [Sent(100 * S, "/tf_static", [Tf("world", "camera", 0)])]
    buffer = bag.load(write_mcap(tmp_path / "run.mcap", [*static, *messages, *tf]), urdf=ARM)
    assert buffer.lookup_transform("base", "shoulder", stamps[3]).transform.translation.x == 7.0
    assert buffer.parent("camera") == "world"
    check(buffer, stamps, values, FRAMES[1:])


@pytest.mark.parametrize("of_link", ["", "/"])
@pytest.mark.parametrize("recorded", ["b", "/b"])
@pytest.mark.parametrize("prefix", ["", "/"])
def test_a_recorded_transform_is_known_by_its_stored_name(of_link, recorded, prefix, tmp_path):
    text = f"<robot><link name='a'/><link name='{of_link}b'/>{joint('ab', 'a', f'{of_link}b')}</robot>"
    moving = [joint_state(n * S, ["ab"], [1.0]) for n in (1, 2)]
    tf = [Sent(n * S, "/tf", [Tf("a", recorded, n * S, (7.0, 0.0, 0.0))]) for n in (1, 3)]
    path = write_mcap(tmp_path / "run.mcap", [*moving, *tf])
    buffer = bag.load(path, urdf=urdf.load(text, prefix=prefix))
    assert buffer.frames()["b"].count == 2
    assert buffer.lookup_transform("a", "b", 2 * S).transform.translation.x == 7.0


def test_states_without_positions_are_ignored(tmp_path):
    messages, stamps, values = states()
    efforts = [joint_state(ns + 1, NAMES, []) for ns in stamps]
    mixed = [one for pair in zip(messages, efforts, strict=True) for one in pair]
    check(bag.load(write_mcap(tmp_path / "run.mcap", mixed), urdf=ARM), stamps, values)
    path = write_mcap(tmp_path / "efforts.mcap", efforts)
    with pytest.raises(bag.BagError, match="its joint states, of lift, .* have no positions of"):
        bag.load(path, urdf=ARM)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (raw(joint_state(0, NAMES, [1.0, 2.0, 3.0]))[:60], "Could not deserialize"),
        (b"", "Invalid or unsupported CDR"),
    ],
)
def test_a_malformed_state_is_named(content, said, tmp_path):
    messages, stamps, _ = states()
    broken = Sent(stamps[7] + 5, "/joint_states", content, JOINT_STATE)
    path = write_mcap(tmp_path / "run.mcap", [*messages[:8], broken, *messages[8:]])
    with pytest.raises(bag.BagError) as refused:
        bag.load(path, urdf=ARM)
    where = f"{path}, topic /joint_states, log time {stamps[7] + 5} ns: "
    assert str(refused.value).startswith(f"{where}{said}")


@pytest.mark.parametrize("count", [1, 2])
def test_states_with_another_number_of_positions_are_left_out(count, tmp_path):
    messages, stamps, values = states()
    bad = [joint_state(stamps[7] + 1 + i, NAMES, [1.0, 2.0]) for i in range(count)]
    path = write_mcap(tmp_path / "run.mcap", [*messages, *bad])
    which = ["1 message on /joint_states is", "2 messages on /joint_states are"][count - 1]
    said = f"{which} left out: 3 names, but 2 positions"
    with pytest.warns(UserWarning, match=f"^{re.escape(str(path))}: {said}$"):
        check(bag.load(path, urdf=ARM), stamps, values)
    heard = read_contents(path, wanted(urdf=ARM))
    assert [line_of(one) for one in report(heard).findings] == [f"malformed: {said}"]


@pytest.mark.parametrize(
    ("added", "urdf", "said"),
    [
        ((), ARM, ""),
        (("mount", "drive", "fly"), ARM, ""),  # fixed, planar, floating
        (("hand", "li-ft"), ARM, "hand, li-ft are not joints of the URDF"),
        ((), ARM.replace('"lift"', '"li.ft"'), "lift is not a joint of the URDF; missing there: li.ft"),
    ],
)
def test_names_that_are_not_joints_are_named(added, urdf, said, tmp_path):
    messages, stamps, _ = states()
    other = [joint_state(stamps[-1] + i, [name], [0.0]) for i, name in enumerate(added)]
    path = write_mcap(tmp_path / "run.mcap", [*messages, *other])
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        bag.load(path, urdf=urdf)
    assert [str(one.message) for one in warned] == ([f"{path}: on /joint_states, {said}"] if said else [])
    (tmp_path / "arm.urdf").write_text(urdf)
    found = report(read_contents(path, wanted(urdf=tmp_path / "arm.urdf"))).findings
    lines = [line_of(one) for one in found if one.kind == "malformed"]
    assert lines == ([f"malformed: on /joint_states, {said}"] if said else [])


def test_states_that_are_all_left_out_are_an_error_with_the_reason(tmp_path):
    path = write_mcap(tmp_path / "run.mcap", [joint_state(S, NAMES, [1.0])])
    with pytest.raises(bag.BagError, match=r"no positions of .* \(3 names, but 1 positions\)$"):
        bag.load(path, urdf=ARM)


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({}, f" has no topic /tf or /tf_static{COMPUTED}"),
        (
            {"topics": ["/joint_states"]},
            ", topic /joint_states: expected the type tf2_msgs/msg/TFMessage, "
            "got sensor_msgs/msg/JointState;"
            " `urdf` or `--urdf` reads it",
        ),
        ({"urdf": {"/arm/states": ARM}}, f" has no topic /tf or /tf_static or /arm/states{COMPUTED}"),
        (
            {"urdf": True},
            ", topic /robot_description: the recording lacks this topic; pass the path of a URDF instead",
        ),
        (
            {"urdf": robot_of(AB, BC)},
            ", topic /joint_states: its joint states, of lift, roll, extend,"
            " have no positions of the URDF's joints, ab, bc",
        ),
        (
            {"urdf": {"/robot/description": ARM}},
            ", topic /robot/description: expected the type sensor_msgs/msg/JointState, "
            "got std_msgs/msg/String",
        ),
        (
            {"urdf": {"/robot/joint_states": True}},
            ", topic /robot/robot_description: not XML: syntax error: line 1, column 0",
        ),
    ],
)
def test_what_does_not_fit_is_told_in_one_sentence(how, said, tmp_path):
    texts = [description("x", topic=f"/robot/{name}") for name in ("description", "robot_description")]
    other = joint_state(S, NAMES, [1.0, 2.0, 3.0], topic="/robot/joint_states")
    path = write_mcap(tmp_path / "run.mcap", [*states()[0], other, *texts])
    with pytest.raises(bag.BagError) as refused:
        bag.load(path, **how)
    assert str(refused.value) == f"{path}{said}"


def test_a_recording_without_joint_states_has_the_fixed_links(tmp_path):
    buffer = bag.load(write_mcap(tmp_path / "run.mcap", drive()), urdf=ARM)
    assert buffer.parent("camera") == "base"  # the recording's own
    assert "shoulder" not in buffer
    fixed = joint_state(S, ["elsewhere"], [1.0])
    alone = robot_of(joint("ab", "a", "b", "fixed"), joint("bc", "b", "c", "fixed"))
    path = write_mcap(tmp_path / "more.mcap", [*drive(), fixed])
    assert bag.load(path, urdf=alone).parent("c") == "b"
