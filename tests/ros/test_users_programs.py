# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Programs as users write them, unchanged: each prints here what it printed on tf2 0.36.20, of ROS 2 Jazzy.

CONTRIBUTING.md tells how to record that anew. No program prints anything that docs/differences.md lists.
"""

import sys

import pytest
from paths import PROGRAMS
from processes import run

pytestmark = pytest.mark.tf2

USERS = PROGRAMS / "users"


def printed_by(program):
    done = run(sys.executable, program, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr  # of a thread, which does not change the status
    return done.stdout


@pytest.mark.parametrize("program", sorted(USERS.glob("*.py")), ids=lambda path: path.stem)
def test_a_program_prints_what_it_prints_on_tf2(program, request):
    recording = program.with_suffix(".out")
    printed = printed_by(program)
    if request.config.getoption("--record"):
        recording.write_text(printed, encoding="utf-8")
    assert printed == recording.read_text(encoding="utf-8")


def test_every_recording_is_of_a_program():
    assert {path.stem for path in USERS.glob("*.out")} == {path.stem for path in USERS.glob("*.py")}
