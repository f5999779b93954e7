# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The demo of the tools."""

import pytest
from processes import output_of
from tool_paths import TOOLS


def test_the_demo_shows_a_recording_its_path_and_its_faults_and_a_robot():
    pytest.importorskip("zenoh")
    shown = output_of(TOOLS / "demo.py", cwd=TOOLS)
    assert "base_link was not received for 1.2 s" in shown and "camera has 2 parents" in shown
    picture = TOOLS / "build" / "path.png"
    assert f"The picture is {picture}\n" in shown and picture.read_bytes().startswith(b"\x89PNG")
    assert "base_link (" in shown and "camera (static)" in shown and "- Translation: [" in shown
