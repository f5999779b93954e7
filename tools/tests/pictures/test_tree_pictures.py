# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of trees, drawn from streams without a node, and read again."""

import re
from xml.etree import ElementTree

import pytest
from picture_samples import HOSTILE, STARTS, stream
from picture_texts import SVG, groups
from starting_programs import needs_dot
from times_and_transforms import S

from tf2_py import FrameInfo
from tf2_ros_tools.diagnosis.findings import Finding
from tf2_ros_tools.pictures.tree import drawn as render
from tf2_ros_tools.pictures.tree import tree_dot

ROBOT = [stream("odom"), stream("base", "odom", publisher="/wheels"), stream("camera", "base", static=True)]
ODOM = FrameInfo("map", False, 9, S, 10_500_000_000)


def drawn(*arguments, **how):
    return render(tree_dot(*arguments, **how), "svg")


def test_an_edge_names_its_publisher_once():
    finding = Finding("future", "odom", "odom by /robot is stamped up to 1 s ahead")
    assert tree_dot(ROBOT, [finding]).count("by /robot") == 1  # below the tree
    # Unless there are several.
    assert tree_dot([*ROBOT, stream("odom", publisher="/other")], [finding]).count("by /robot") > 1


@needs_dot
class TestTree:
    def test_has_a_node_for_each_frame_and_an_edge_for_each_stream(self):
        svg = drawn(ROBOT, infos={"odom": ODOM}, time=12.5)
        assert sorted(groups(svg, "frame")) == [["base"], ["camera"], ["map"], ["odom"]]
        assert groups(svg, "static") == [["/robot", "static"]]
        figures = ["50.0 Hz", "delay 1.0 ms, max 4.0 ms"]
        assert sorted(groups(svg, "dynamic")) == [
            ["/robot", *figures, "buffer 9.50 s"],
            ["/wheels", *figures],
        ]
        assert [["Recorded at time: 12.500"]] == [lines[:1] for lines in groups(svg, "cluster")]
        assert sorted(groups(svg, "legend")) == [["dynamic"], ["problem"], ["stale"], ["static"]]

    def test_a_problem_is_marked_on_its_edges_with_the_reason(self):
        loop = [stream("a", "b"), stream("b", "a")]
        svg = drawn(
            [*ROBOT, *loop, stream("base", publisher="/intruder")],
            [
                Finding("loop", "a", "the frames a -> b -> a form a loop", ("a", "b")),
                Finding("publishers", "base", "base is published by 2 publishers: /intruder, /wheels"),
                Finding("refused", "ghost", "3 transforms of ghost by /robot are refused: not a number"),
                Finding("roots", "", "2 unconnected trees"),
            ],
        )
        marked = {tuple(lines[:1] + lines[3:]) for lines in groups(svg, "problem")}
        assert marked == {
            ("/robot", "the frames a -> b -> a form a", "loop"),
            ("/wheels", "is published by 2 publishers:", "/intruder, /wheels"),
            ("/intruder", "is published by 2 publishers:", "/intruder, /wheels"),
            ("ghost",),  # it has no edge
        }

    def test_nodes_have_the_names_of_their_frames(self):
        dot = tree_dot([stream("odom"), stream("a:b", "odom"), stream("robot1/base link", "odom")])
        assert re.search(r"^\s*map -> odom ", dot, re.MULTILINE)
        assert re.search(r'^\s*odom -> "robot1/base link" ', dot, re.MULTILINE)
        assert '"a:b"' not in dot.replace('label="a:b"', "").replace('tooltip="a:b"', "")

    def test_the_oldest_and_the_most_recent_stamp_are_shown_beside_an_edge(self):
        svg = drawn(ROBOT, infos={"odom": ODOM})
        titles = [
            one.get("{http://www.w3.org/1999/xlink}title") for one in ElementTree.fromstring(svg).iter()
        ]
        [title] = {title for title in titles if title and "oldest" in title}
        assert "most recent transform: 10.500000" in title and "oldest transform: 1.000000" in title

    @pytest.mark.parametrize("name", HOSTILE)
    def test_shows_a_name_as_it_is(self, name):
        svg = drawn([stream(name, publisher=name)])
        assert sorted(groups(svg, "frame")) == sorted([["map"], [name]])
        assert [lines[0] for lines in groups(svg, "dynamic")] == [name]

    def test_of_nothing_says_so(self):
        texts = [text.text for text in ElementTree.fromstring(drawn([])).iter(f"{SVG}text")]
        assert "no transform was received" in texts

    @pytest.mark.parametrize("kind", STARTS)
    def test_every_format_is_what_its_name_says(self, kind):
        assert render(tree_dot(ROBOT), kind).startswith(STARTS[kind])
