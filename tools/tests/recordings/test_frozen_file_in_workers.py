# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Workers that share a frozen file find the same poses."""

import shutil

from documentation_pages import named_programs
from pickles_and_copies import held
from processes import output_of
from tool_paths import DOCS, SAMPLES

from tf2_ros import Buffer
from tf2_ros_tools import bag


def test_the_loader_of_the_page_hands_its_workers_the_same_poses(tmp_path):
    shutil.copytree(SAMPLES / "drive", tmp_path / "drive")
    program = tmp_path / "loader.py"
    code = named_programs(DOCS / "saved-buffers.md")["loader.py"]
    for method in ("spawn", "forkserver", "fork"):
        program.write_text(code.replace('get_context("spawn")', f'get_context("{method}")'), encoding="utf-8")
        assert output_of(program, cwd=tmp_path) == "10 (100, 7)\n"
    assert held(Buffer.open(tmp_path / "drive.tf2")) == held(bag.load(tmp_path / "drive"))
