# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A robot's joints: what a URDF says, and the transforms of their positions."""

import numpy as np
import pytest
from robot_of_all_joints import ARM, FRAMES, NAMES, expected, random_states
from urdfs_of_three_links import AB, BC, LINKS, joint, robot_of

from tf2_ros.numpy import to_matrix
from tf2_ros_tools import urdf


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


def with_more(more):
    return robot_of(AB, joint("bc", "b", "c", more=more))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot", "not XML: unclosed token: line 1, column 0"),
        ("<robot><!-- a -- b --></robot>", "not XML: not well-formed (invalid token): line 1, column 16"),
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
        f"{XML}{ONE}".encode(),
        f"\ufeff{XML}{ONE}".encode(),
        f'<?xml version="1.0" encoding="ISO-8859-1"?>{with_inside("<!-- é -->")}'.encode("latin-1"),
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
    [("", "utf-8"), ("UTF-8", "utf-8"), ("ISO-8859-15", "iso-8859-15"), ("cp1252", "cp1252")],
)
def test_names_are_read_in_the_encoding_of_the_file(declaration, encoding, tmp_path):
    declared = f'<?xml version="1.0" encoding="{declaration}"?>' if declaration else ""
    text = f"{declared}{robot_of(AB, joint('bc', 'b', 'c'))}".replace('"c"', '"größe"')
    path = tmp_path / "robot.urdf"
    path.write_bytes(text.encode(encoding))
    assert urdf.load(path).joints[1].child == "größe"


def test_a_text_may_begin_with_a_blank_line_and_say_anything_of_its_encoding():
    assert urdf.load(f'\ufeff\n <?xml version="1.0" encoding="UTF-16"?>{ONE}').root == "a"


@pytest.mark.parametrize("declared", ["", ' encoding="UTF-16"'])
def test_utf_16_needs_no_declaration(declared, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(f'<?xml version="1.0"{declared}?>{ONE}'.replace('"c"', '"größe"'), encoding="utf-16")
    assert urdf.load(path).joints[1].child == "größe"


@pytest.mark.parametrize(
    ("declared", "said"), [("x-no", "unknown encoding: x-no"), ("US-ASCII", "not well-formed")]
)
def test_an_encoding_that_is_unknown_or_wrong_is_refused(declared, said, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_bytes(f"<?xml version='1.0' encoding='{declared}'?><robot name='é'/>".encode("latin-1"))
    with pytest.raises(urdf.UrdfError, match=f"^{path}: not XML: {said}"):
        urdf.load(path)


def test_a_hostile_text_is_refused_without_taking_time_or_memory():
    entities = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10))
    text = f'<!DOCTYPE robot [<!ENTITY a0 "{100 * "x"}">{entities}]><robot name="&a9;"/>'
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
