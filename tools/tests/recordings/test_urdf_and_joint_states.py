# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A robot's joints: what a URDF says, and the transforms of live and recorded joint states."""

import re
import warnings

import numpy as np
import pytest
from making_bags import FORMATS, S, Sent, Tf, drive, raw, write_mcap
from robot_of_all_joints import (
    ARM,
    FIXED,
    JOINT_STATE,
    NAMES,
    description,
    expected,
    joint_state,
    random_states,
)

from tf2_ros.numpy import to_matrix
from tf2_ros_tools import bag, urdf
from tf2_ros_tools.diagnosis.texts import line_of
from tf2_ros_tools.recordings.bag_loader import hear, wanted
from tf2_ros_tools.recordings.report import report

pytestmark = pytest.mark.ours

FRAMES = ("shoulder", "wheel", "slide", "finger", "thumb")


class TestRobot:
    def test_every_type_of_joint_moves_as_matrices_say(self):
        states = random_states(50)
        joints, translations, rotations = urdf.load(ARM).transforms(NAMES, states)
        assert [one.child for one in joints] == list(FRAMES)
        for n, state in enumerate(states):
            for k, one in enumerate(joints):
                parent, matrix = expected(*state)[one.child]
                assert one.parent == parent
                found = to_matrix((translations[n, k], rotations[n, k]))
                np.testing.assert_allclose(found, matrix, rtol=0, atol=1e-12)

    def test_joints_say_what_the_urdf_says(self):
        robot = urdf.load(ARM)
        by_name = {one.name: one for one in robot.joints}
        assert (robot.name, robot.root, len(robot.joints)) == ("arm", "base", 7)
        assert by_name["grip"].mimic == ("extend", -0.5, 0.02)
        assert by_name["lift"].axis == pytest.approx((0, 2 / 5**0.5, 1 / 5**0.5))
        assert repr(robot) == "<tf2_ros_tools.urdf.Robot 'arm': 5 movable and 2 fixed joints, root 'base'>"

    def test_joints_move_only_if_their_positions_are_given(self):
        robot = urdf.load(ARM)
        names = ["drive", "fly", "mount", "unknown"]
        robot.transforms(names, [1, 1, 1, 1])[0].append(None)  # the caller's own list
        assert robot.transforms(names, [1, 1, 1, 1])[0] == []
        # A joint that has its own position follows no other; the first of equal names counts.
        joints, *found = robot.transforms(["grip", "extend", "grip"], [0.3, 0.1, 0.9])
        assert [one.name for one in joints] == ["extend", "grip", "pinch"]
        np.testing.assert_allclose(found[0][1], [0.3, 0, 0])

    def test_nan_makes_its_joint_and_those_that_mimic_it_nan(self):
        joints, translations, rotations = urdf.load(ARM).transforms(NAMES, [0.5, 0.5, float("nan")])
        poses = zip(joints, np.hstack([translations, rotations]), strict=True)
        lost = {one.name for one, pose in poses if np.isnan(pose).any()}
        assert lost == {"extend", "grip", "pinch"}

    @pytest.mark.parametrize(
        ("names", "positions", "shape"),
        [(NAMES, [1.0], "(1,)"), (NAMES, 1.0, "()"), ([], [[[]]], "(1, 1, 0)")],
    )
    def test_positions_of_another_shape_are_refused(self, names, positions, shape):
        with pytest.raises(ValueError) as refused:
            urdf.load(ARM).transforms(names, positions)
        expected = f"({len(names)},) or (N, {len(names)})"
        assert str(refused.value) == f"positions: expected the shape {expected}, got {shape}"


LINKS = "".join(f'<link name="{name}"/>' for name in "abc")


def joint(name, parent, child, kind="revolute", more=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>'
    )


def robot_of(*parts):
    """A URDF with the links a, b and c."""
    return f"<robot>{LINKS}{''.join(parts)}</robot>"


AB, BC = joint("ab", "a", "b"), joint("bc", "b", "c")


def with_more(more):
    return robot_of(AB, joint("bc", "b", "c", more=more))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot", "not XML: unclosed token: line 1, column 0"),
        ("<sdf/>", "expected the root element <robot>, got <sdf>"),
        ("<robot><link/></robot>", "a link has no name"),
        (robot_of(LINKS), "there are two links a"),
        (robot_of(AB, AB), "there are two joints ab"),
        (robot_of(AB), "expected one link without a parent, got 2: a, c"),
        (robot_of(AB, joint("x", "d", "c")), "joint x: its parent d is not a link of the robot"),
        (robot_of('<joint name="x" type="fixed"/>'), "joint x has no parent"),
        (
            robot_of(AB, BC, joint("ac", "a", "c")),
            "link c has two parents: it is the child of the joints bc and ac",
        ),
        (robot_of(AB, BC, joint("ca", "c", "a")), "link a is its own ancestor"),
        (
            robot_of(AB, joint("bc", "b", "c", "hinge")),
            "joint bc: expected the type fixed, revolute, continuous, prismatic, planar or floating, "
            "got hinge",
        ),
        (
            robot_of(
                joint("ab", "a", "b", more='<mimic joint="bc"/>'),
                joint("bc", "b", "c", more='<mimic joint="ab"/>'),
            ),
            "joint ab mimics itself",
        ),
        (with_more('<mimic joint="ab" offset="x"/>'), "joint bc: offset: expected a finite number, got 'x'"),
        (with_more('<origin xyz="1 2"/>'), "joint bc: xyz: expected three finite numbers, got '1 2'"),
        (with_more('<axis xyz="0 0 0"/>'), "joint bc: its axis must not be (0, 0, 0)"),
    ],
)
def test_what_is_not_a_tree_of_joints_is_refused_in_one_sentence(text, said):
    with pytest.raises(urdf.UrdfError) as refused:
        urdf.load(text)
    assert str(refused.value) == said


def test_a_joint_that_mimics_an_unknown_one_is_left_out_with_a_warning():
    chained = joint("ac", "a", "c", more='<mimic joint="ab"/>')
    text = robot_of(joint("ab", "a", "b", more='<mimic joint="x" multiplier="2"/>'), chained)
    said = "^joint ab mimics x, which is not a joint; it is left out, except where its own position is given$"
    with pytest.warns(UserWarning, match=said) as caught:
        robot = urdf.load(text)
    assert [one.filename for one in caught] == [__file__]
    assert robot.joints[0].mimic == ("x", 2, 0)
    assert robot.transforms(["x"], [1.0])[0] == []
    # As with robot_state_publisher.
    assert [one.name for one in robot.transforms(["ab"], [1.0])[0]] == ["ab", "ac"]


XML = '<?xml version="1.0"?>'
ONE = robot_of(AB, BC)


def with_inside(text):
    return robot_of(AB, BC, text)


@pytest.mark.parametrize(
    "text",
    [
        # Namespaces have no meaning; a prefix is a part of a name.
        ONE.replace("<robot>", '<robot xmlns="http://www.ros.org">'),
        ONE.replace("<joint ", '<joint xmlns="http://www.ros.org" '),
        with_inside('<gazebo><sensor:camera name="rgb"/></gazebo>'),
        with_inside('<gazebo sensor:name="rgb"><a:b:c/></gazebo>'),
        with_inside('<sensor:link name="d"/>'),
        with_inside("<gazebo><xacro:sensor rate='${rate}'/></gazebo>"),
        # What comes before the declaration, and what the declaration says.
        f"\n{XML}{ONE}",
        f" \t\r\n{XML}\n{ONE}",
        f"\ufeff\n{XML}{ONE}",
        f'<?xml version="1.0" encoding="us-ascii"?><!-- é -->{ONE}',
        f'<?xml version="1.0" encoding="UTF-16"?>{ONE}',
        f"<?xml?>{ONE}",
        # What is in a comment.
        with_inside("<!-- a -- b ---- c -->"),
        with_inside("<!-- a --->"),
        with_inside('<!-- <link name="d"/> <!-- -->'),
        with_inside("<gazebo><![CDATA[ <!-- ]]></gazebo><!-- -->"),
        # The end.
        f"{ONE}\0",
        f"{ONE}\n\0\0",
        f"{ONE}\0<robot",
        with_inside('<gazebo name="black & white"/>'),
        # Bytes that are not UTF-8.
        with_inside("<!-- gr\xfcn -->").encode("latin-1"),
        with_inside('<material name="gr\xfcn"/>').encode("latin-1"),
        f'<?xml version="1.0" encoding="windows-1252"?>{with_inside("<!-- – -->")}'.encode("cp1252"),
        f"\ufeff{XML}{ONE}".encode(),
        # A planar joint is fixed, so its axis is not needed.
        robot_of(AB, joint("bc", "b", "c", "planar", more='<axis xyz="0 0 0"/>')),
    ],
)
def test_what_robot_state_publisher_accepts_is_accepted_silently(text, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    for robot in [urdf.load(path), *([urdf.load(text)] if isinstance(text, str) else [])]:
        assert [(one.name, one.parent, one.child) for one in robot.joints] == [
            ("ab", "a", "b"),
            ("bc", "b", "c"),
        ]
        assert robot.warnings == ()


@pytest.mark.parametrize(
    ("declaration", "encoding"),
    [
        ("", "utf-8"),
        ("", "latin-1"),
        ("UTF-8", "utf-8"),
        ("ISO-8859-15", "iso-8859-15"),
        ("cp1252", "cp1252"),
    ],
)
@pytest.mark.parametrize("comment", ["", "<!-- gr\xfcn -->"])
def test_names_are_read_in_the_encoding_of_the_file(declaration, encoding, comment, tmp_path):
    declared = f'<?xml version="1.0" encoding="{declaration}"?>' if declaration else ""
    text = f"{declared}{robot_of(AB, joint('bc', 'b', 'c'))}".replace('"c"', '"größe"')
    path = tmp_path / "robot.urdf"
    path.write_bytes(text.encode(encoding) + comment.encode("latin-1"))
    assert urdf.load(path).joints[1].child == "größe"


@pytest.mark.parametrize(
    "text",
    [
        f'<!DOCTYPE robot [<!ENTITY a0 "{100 * "x"}">'
        + "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10))
        + ']><robot name="&a9;"/>',
        "<robot>" + 300_000 * "<!--",
        "<robot>" + 300_000 * "<![CDATA[",
        "<robot>" + 300_000 * "<?",
        "<robot " + 300_000 * "&",
    ],
    ids=["entities", "comments", "data", "instructions", "ampersands"],
)
def test_a_hostile_text_is_refused_without_taking_time_or_memory(text):
    with pytest.raises(urdf.UrdfError, match="^not XML: "):
        urdf.load(text)


@pytest.mark.parametrize(
    "text",
    [
        robot_of(AB, joint("bc", "b", "c", more="<xacro:origin/>")),
        "<robot><xacro:include filename='arm.xacro'/></robot>",
        "<robot xmlns:xacro='http://www.ros.org/wiki/xacro'><xacro:arm/></robot>",
        "<robot xmlns:xacro='http://ros.org/wiki/xacro'><link name='${prefix}base'/></robot>",
        with_more('<origin xyz="0 0 ${h}"/>'),
    ],
)
def test_xacro_that_was_not_expanded_is_named(text):
    with pytest.raises(urdf.UrdfError, match="^it contains xacro, which must be expanded first"):
        urdf.load(text)


@pytest.mark.parametrize(
    ("prefix", "frames"),
    [("", ["a", "b"]), ("/", ["a", "b"]), ("r/", ["r/a", "r/b"]), ("/r/", ["r/a", "r/b"])],
)
@pytest.mark.parametrize("links", [("a", "b"), ("/a", "b"), ("a", "/b")])
def test_a_leading_slash_is_not_a_part_of_a_frame(prefix, frames, links):
    text = "".join(f'<link name="{name}"/>' for name in links)
    robot = urdf.load(f"<robot>{text}{joint('ab', *links)}</robot>", prefix=prefix)
    assert [robot.root, robot.joints[0].child] == frames == [robot.joints[0].parent, robot.joints[0].child]


def test_two_links_that_are_one_frame_are_refused():
    text = f'<robot><link name="a"/><link name="/a"/>{joint("j", "a", "/a")}</robot>'
    with pytest.raises(urdf.UrdfError, match="^the links /a and a are the same frame$"):
        urdf.load(text)


def test_a_file_that_is_not_one_is_named(tmp_path):
    with pytest.raises(FileNotFoundError):
        urdf.load(tmp_path / "none.urdf")
    path = tmp_path / "broken.urdf"
    path.write_bytes(b"\x89PNG")
    with pytest.raises(urdf.UrdfError) as refused:
        urdf.load(path)
    assert str(refused.value).startswith(f"{path}: not XML: ")


# Recordings.


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


class TestRecordings:
    @pytest.mark.parametrize("form", ["folder-sqlite3", "mcap", "ros1"])
    def test_an_arm_without_tf_has_its_links(self, form, tmp_path):
        messages, stamps, values = states(ros=1 if form == "ros1" else 2)
        buffer = bag.load(FORMATS[form](tmp_path, messages), urdf=ARM)
        check(buffer, stamps, values)
        camera = to_matrix(buffer.lookup_transform("shoulder", "camera", 0))
        np.testing.assert_allclose(camera, FIXED["camera"][1], atol=1e-12)
        assert buffer.frames()["camera"].static
        assert "broadcaster: '/joint_states'" in buffer.all_frames_as_yaml()

    def test_more_states_than_a_batch_holds_are_in_order(self, tmp_path, monkeypatch):
        monkeypatch.setattr("tf2_ros_tools.recordings.joints_and_poses.BATCH", 7)
        messages, stamps, values = states(100)
        path = write_mcap(tmp_path / "run.mcap", messages)
        check(bag.load(path, urdf=ARM), stamps, values)
        heard = hear(path, wanted(urdf=ARM))
        moving = heard.records[heard.records["static"] == 0]
        assert moving["stamp_ns"].tolist() == np.repeat(stamps, len(FRAMES)).tolist()
        assert set(heard.publishers) == {"urdf", "/joint_states"}

    def test_several_robots_have_their_own_topics_and_prefixes(self, tmp_path):
        left, stamps, values = states(topic="/left/joint_states")
        right, _, _ = states(20, topic="/right/joint_states")
        path = write_mcap(
            tmp_path / "run.mcap", [description(topic="/right/robot_description"), *left, *right]
        )
        robots = {"/left/joint_states": urdf.load(ARM, prefix="left/"), "/right/joint_states": True}
        buffer = bag.load(path, urdf=robots)
        check(buffer, stamps, values, prefix="left/")
        check(buffer, stamps[:20], values[:20])

    def test_recorded_transforms_come_before_computed_ones(self, tmp_path):
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
    def test_a_recorded_transform_is_known_by_its_stored_name(self, of_link, recorded, prefix, tmp_path):
        text = f"<robot><link name='a'/><link name='{of_link}b'/>{joint('ab', 'a', f'{of_link}b')}</robot>"
        moving = [joint_state(n * S, ["ab"], [1.0]) for n in (1, 2)]
        tf = [Sent(n * S, "/tf", [Tf("a", recorded, n * S, (7.0, 0.0, 0.0))]) for n in (1, 3)]
        path = write_mcap(tmp_path / "run.mcap", [*moving, *tf])
        buffer = bag.load(path, urdf=urdf.load(text, prefix=prefix))
        assert buffer.frames()["b"].count == 2
        assert buffer.lookup_transform("a", "b", 2 * S).transform.translation.x == 7.0

    def test_states_without_positions_are_ignored(self, tmp_path):
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
    def test_a_malformed_state_is_named(self, content, said, tmp_path):
        messages, stamps, _ = states()
        broken = Sent(stamps[7] + 5, "/joint_states", content, JOINT_STATE)
        path = write_mcap(tmp_path / "run.mcap", [*messages[:8], broken, *messages[8:]])
        with pytest.raises(bag.BagError) as refused:
            bag.load(path, urdf=ARM)
        where = f"{path}, topic /joint_states, log time {stamps[7] + 5} ns: "
        assert str(refused.value).startswith(f"{where}{said}")

    @pytest.mark.parametrize("count", [1, 2])
    def test_states_with_another_number_of_positions_are_left_out(self, count, tmp_path):
        messages, stamps, values = states()
        bad = [joint_state(stamps[7] + 1 + i, NAMES, [1.0, 2.0]) for i in range(count)]
        path = write_mcap(tmp_path / "run.mcap", [*messages, *bad])
        which = ["1 message on /joint_states is", "2 messages on /joint_states are"][count - 1]
        said = f"{which} left out: 3 names, but 2 positions"
        with pytest.warns(UserWarning, match=f"^{re.escape(str(path))}: {said}$"):
            check(bag.load(path, urdf=ARM), stamps, values)
        heard = hear(path, wanted(urdf=ARM))
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
    def test_names_that_are_not_joints_are_named(self, added, urdf, said, tmp_path):
        messages, stamps, _ = states()
        other = [joint_state(stamps[-1] + i, [name], [0.0]) for i, name in enumerate(added)]
        path = write_mcap(tmp_path / "run.mcap", [*messages, *other])
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            bag.load(path, urdf=urdf)
        assert [str(one.message) for one in warned] == ([f"{path}: on /joint_states, {said}"] if said else [])
        (tmp_path / "arm.urdf").write_text(urdf)
        found = report(hear(path, wanted(urdf=tmp_path / "arm.urdf"))).findings
        lines = [line_of(one) for one in found if one.kind == "malformed"]
        assert lines == ([f"malformed: on /joint_states, {said}"] if said else [])

    def test_states_that_are_all_left_out_are_an_error_with_the_reason(self, tmp_path):
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
    def test_what_does_not_fit_is_told_in_one_sentence(self, how, said, tmp_path):
        texts = [description("x", topic=f"/robot/{name}") for name in ("description", "robot_description")]
        other = joint_state(S, NAMES, [1.0, 2.0, 3.0], topic="/robot/joint_states")
        path = write_mcap(tmp_path / "run.mcap", [*states()[0], other, *texts])
        with pytest.raises(bag.BagError) as refused:
            bag.load(path, **how)
        assert str(refused.value) == f"{path}{said}"

    def test_a_recording_without_joint_states_has_the_fixed_links(self, tmp_path):
        buffer = bag.load(write_mcap(tmp_path / "run.mcap", drive()), urdf=ARM)
        assert buffer.parent("camera") == "base"  # the recording's own
        assert "shoulder" not in buffer
        fixed = joint_state(S, ["elsewhere"], [1.0])
        alone = robot_of(joint("ab", "a", "b", "fixed"), joint("bc", "b", "c", "fixed"))
        path = write_mcap(tmp_path / "more.mcap", [*drive(), fixed])
        assert bag.load(path, urdf=alone).parent("c") == "b"
