# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Programs as users write them, unchanged: each prints here what it printed on tf2 0.36.20, of ROS 2 Jazzy.

CONTRIBUTING.md tells how to record that anew. No program prints anything that docs/differences.md lists.
"""

import subprocess
import sys

import pytest
import reference
from excused_faults import tried
from paths import PROGRAMS
from processes import run
from waiting import DEADLINE_S

pytestmark = pytest.mark.tf2

USERS = PROGRAMS / "users"
# From Lyrical on, a BufferClient's `transform` raises a TypeError, because it passes a message as a time.
ONLY = {"client_of_own_action_server": ("0.36", "0.41")}


def printed_by(program):
    if reference.release is None:
        done = run(sys.executable, program, encoding="utf-8")
    else:
        if "tf2_sensor_msgs" in program.read_text(encoding="utf-8"):
            reference.imported("tf2_sensor_msgs")
        done = tried(lambda: run_on_tf2(program))
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr  # of a thread, which does not change the status
    return done.stdout


def run_on_tf2(program):
    """What it ended with; a program whose `BufferClient` gets no answer, because rclpy has lost it, hangs."""
    try:
        return run(sys.executable, program, encoding="utf-8", timeout=DEADLINE_S)
    except subprocess.TimeoutExpired as hung:
        said = [(text or b"").decode("utf-8", "replace") for text in (hung.stdout, hung.stderr)]
        return subprocess.CompletedProcess(hung.cmd, -1, *said)


def programs():
    for program in sorted(USERS.glob("*.py")):
        marks = [pytest.mark.tf2(*ONLY[program.stem])] if program.stem in ONLY else []
        yield pytest.param(program, id=program.stem, marks=marks)


@pytest.mark.parametrize("program", programs())
def test_a_program_prints_what_it_prints_on_tf2(program, request):
    recording = program.with_suffix(".out")
    printed = printed_by(program)
    if request.config.getoption("--record"):
        recording.write_text(printed, encoding="utf-8")
    assert printed == recording.read_text(encoding="utf-8")


def test_every_recording_is_of_a_program():
    assert {path.stem for path in USERS.glob("*.out")} == {path.stem for path in USERS.glob("*.py")}
