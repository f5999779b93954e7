# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the documentation that start this project's programs run as its pages show them."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import tempfile
from contextlib import ExitStack
from importlib.util import find_spec

import pytest
from documentation_pages import blocks, commands
from starting_programs import broadcasting, command, free_port, heard, running
from tool_pages import ALL_PAGES
from tool_paths import SAMPLES
from tool_project import PYPROJECT
from waiting import DEADLINE_S, until

pytestmark = pytest.mark.long("runs 60 programs, some for half a minute")

# tf2_buffer_server prints nothing.
PROGRAMS = set(PYPROJECT["project"]["scripts"]) - {"tf2_buffer_server"}
# The files that the pages show as text, by their first words.
FILES = {
    "frames:": "robot.yaml",
    "- {frame_id": "transforms.yaml",
    "1002.0 -0.5": "optimized.tum",
}
# These end by themselves, the others with Ctrl-C.
ENDING = re.compile(r"tf2_(bag|check|plot)|view_frames|tf2_echo .*--once")
WEB_PORT = "8000"  # of the pages, which another program of this machine may use
# What a program that runs on prints first when it works; others print anything.
WORKING = {"tf2_echo": "At time", "tf2_echo base_link camra": "Did you mean"}
# By program, what it must hear of the robot and of static_transform_publisher before it ends.
HEARS = dict.fromkeys(
    ("tf2_check", "tf2_plot", "view_frames"), heard("camera", "robot", odom=50, base_link=50)
)
# PyPI lacks cyclonedds for some systems.
NO_DDS = "" if find_spec("cyclonedds") else "|cyclonedds is not installed"
# The status that is not 0, and what the program then prints.
REPORTED = {
    1: re.compile(rf"^\d+ problems? in |which has the program dot{NO_DDS}", re.MULTILINE),
    130: re.compile("camra"),
}


def started(page):
    """The commands of a page that start one of the programs."""
    return [(variables, words) for variables, words in commands(page) if words and words[0] in PROGRAMS]


@pytest.fixture
def folder(tmp_path):
    """A folder with the samples, as the pages begin, and the files that they show."""
    shutil.copytree(SAMPLES, tmp_path, dirs_exist_ok=True)
    for name in ("drives/monday", "recordings/drive"):
        shutil.copytree(SAMPLES / "drive", tmp_path / name)
    for page in ALL_PAGES:
        for block in blocks(page):
            for first, name in FILES.items():
                if block.language == "text" and block.code.startswith(first):
                    (tmp_path / name).write_text(block.code, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("page", [pytest.param(page, id=page.name) for page in ALL_PAGES if started(page)])
def test_the_commands_of_a_page_run(page, folder):
    # All at once, because most of them listen; but first those that write a recording, which others may read.
    frame = ["--frame-id", "base_link", "--child-frame-id", "robot"]
    lines = started(page)
    writing = [one for one in lines if one[1][1:2] == ["rewrite"]]
    with broadcasting(), running("static_transform_publisher", *frame), ExitStack() as ends:
        for some in (writing, [one for one in lines if one not in writing]):
            for one in [Started(*line, folder, ends) for line in some]:
                one.end()


class Started:
    def __init__(self, variables, words, folder, ends):
        self.line = shlex.join(words)
        self.output = ends.enter_context(tempfile.TemporaryFile("w+"))
        self.process = subprocess.Popen(
            command(
                *(str(free_port()) if one == WEB_PORT else one for one in words), hears=HEARS.get(words[0])
            ),
            cwd=folder,
            env={**os.environ, **variables},
            stdout=self.output,
            stderr=self.output,
        )
        ends.callback(self.process.kill)

    def printed(self):
        return os.pread(self.output.fileno(), 1 << 20, 0).decode()

    def end(self):
        if not ENDING.match(self.line):
            first = WORKING.get(self.line) or WORKING.get(self.line.split()[0], "")
            until(lambda: self.process.poll() is not None or (self.printed() and first in self.printed()))
            self.process.send_signal(signal.SIGINT)
        status, printed = self.process.wait(DEADLINE_S), self.printed()
        expected = re.compile("") if status == 0 else REPORTED.get(status)
        assert expected and expected.search(printed), f"{self.line}: {status}\n{printed}"
