# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""view_frames, as a process of its own, beside one that broadcasts."""

import os
import re

import pytest
from picture_texts import groups
from starting_programs import NAMED_ROBOT, ROBOT, broadcasting, ended, needs_dot

from tf2_ros_tools.programs.view_frames import output_files

TREE = re.compile(
    r"""map
  odom \(\d+ samples over [\d.]+ s, newest at \d+\.\d+\)
    base_link \(\d+ samples over [\d.]+ s, newest at \d+\.\d+\)
      camera \(static\)
(
((gap|stale): .*
)+)?"""  # on a busy machine a healthy robot has gaps
)


@pytest.fixture(scope="module")
def robot():
    with broadcasting() as process:
        yield process


@pytest.mark.parametrize(
    ("output", "files"),
    [
        ("robot", ("robot.gv", "robot.pdf", "pdf")),
        ("robot.v2", ("robot.v2.gv", "robot.v2.pdf", "pdf")),
        ("a.b/robot.svg", ("a.b/robot.gv", "a.b/robot.svg", "svg")),
        ("robot.PNG", ("robot.gv", "robot.PNG", "png")),
    ],
)
def test_files_are_named_after_the_output(output, files):
    assert output_files(output) == files


@needs_dot
class TestRobot:
    def test_both_files_show_the_robot(self, robot, tmp_path):
        status, out, err = ended("view_frames", "-t", "4", "-o", "robot.svg", hears=NAMED_ROBOT, cwd=tmp_path)
        assert (status, out) == (0, "robot.gv\nrobot.svg\n")
        assert "Listening to tf data for 4.0 seconds..." in err
        assert "digraph" in (tmp_path / "robot.gv").read_text()
        svg = (tmp_path / "robot.svg").read_bytes()
        assert sorted(groups(svg, "frame")) == [["base_link"], ["camera"], ["map"], ["odom"]]
        assert groups(svg, "static") == [["/fleet/robot", "static"]]
        assert len(groups(svg, "dynamic")) == 2
        for publisher, rate, delay, length, *_ in groups(svg, "dynamic"):
            assert publisher == "/fleet/robot"
            assert 1 < float(re.fullmatch(r"([\d.]+) Hz", rate)[1]) < 500  # 50 on a machine that is not busy
            assert re.fullmatch(r"delay \d+\.\d ms, max \d+\.\d ms", delay)
            assert 0 < float(re.fullmatch(r"buffer ([\d.]+) s", length)[1]) <= 10


def test_the_text_is_a_tree_writes_no_file_and_needs_no_library(robot, tmp_path):
    (tmp_path / "graphviz.py").write_text("raise ImportError")
    status, out, err = ended("view_frames", "--text", hears=ROBOT, cwd=tmp_path)
    assert status == 0, err
    assert TREE.fullmatch(out)
    assert "no transform was received" not in err
    assert [one.name for one in tmp_path.iterdir()] == ["graphviz.py"]


def test_without_dot_there_is_the_description(robot, tmp_path):
    environment = {**os.environ, "PATH": str(tmp_path)}
    status, out, err = ended("view_frames", "-o", "robot", hears=ROBOT, cwd=tmp_path, env=environment)
    assert (status, out) == (1, "robot.gv\n")
    assert [path.name for path in tmp_path.iterdir()] == ["robot.gv"]
    said = "view_frames: no picture: install Graphviz"
    assert err.splitlines()[-1].startswith(said)
