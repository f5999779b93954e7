# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What `make demo` and `make test` do before they start, on new machines and after a step that failed."""

import os
import shutil
import signal
import subprocess
import sys

import pytest
from installing import unsourced
from paths import ROOT
from processes import run
from waiting import DEADLINE_S, until

STAMP = ".venv/wheels.stamp"
# A project whose build does not end.
HANGING = """
import pathlib, time

def get_requires_for_build_editable(config_settings=None):
    pathlib.Path("begun").touch()
    time.sleep(10_000)

def build_editable(*arguments):
    pass

build_wheel = build_editable
"""


def copied_to(folder):
    """A folder like a checkout, with what make reads before it builds."""
    for name in ("Makefile", "step.mk", "build_backend/required_tools.py"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    return folder


@pytest.fixture
def folder(tmp_path):
    return copied_to(tmp_path / "folder")


@pytest.fixture(scope="module")
def folder_with_pip(tmp_path_factory):
    """The same with a virtual environment, as a step that failed or was interrupted leaves it."""
    folder = copied_to(tmp_path_factory.mktemp("folder"))
    run(sys._base_executable, "-m", "venv", "--without-pip", folder / ".venv")
    ended = make(folder, STAMP)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout == "Creating .venv: some seconds, see .venv/install.log\n"
    return folder


def provide_project(folder, backend, code):
    """Put a project with this backend in the place of the messages."""
    (folder / "messages").mkdir(exist_ok=True)
    (folder / "messages" / f"{backend}.py").write_text(code)
    (folder / "messages" / "pyproject.toml").write_text(
        f"[build-system]\nrequires = []\nbuild-backend = '{backend}'\nbackend-path = ['.']\n"
    )


def environment():
    """That of a new shell, even if make itself runs these tests."""
    return {name: value for name, value in unsourced().items() if not name.startswith(("MAKE", "MFLAGS"))}


def make(folder, *arguments, **variables):
    python = f"PYTHON={sys._base_executable}"
    return run(
        "make", python, *arguments, cwd=folder, env={**environment(), "PIP_NO_INDEX": "1", **variables}
    )


def test_all_missing_tools_are_named_before_anything_is_created(folder, tmp_path):
    programs = tmp_path / "programs"
    programs.mkdir()
    for name in ("sh", "make", "test", "echo"):
        (programs / name).symlink_to(shutil.which(name))
    ended = make(folder, STAMP, PATH=str(programs), CC="some-cc -O2", CXX="some-c++")
    assert ended.returncode == 2
    assert ended.stdout.splitlines() == [
        "no C compiler (some-cc): install gcc",
        "no C++ compiler (some-c++): install g++",
        "On Debian and Ubuntu: sudo apt install make g++ python3-dev python3-venv",
    ]
    assert not (folder / ".venv").exists()
    ended = make(folder, STAMP, "PYTHON=no-python", PATH=str(programs))
    assert ended.stdout.splitlines()[0] == "no no-python: install Python 3.10 or newer"
    assert not (folder / ".venv").exists()


def test_an_environment_that_was_left_without_pip_is_completed(folder_with_pip):
    folder = folder_with_pip
    assert run(folder / ".venv" / "bin" / "python", "-m", "pip", "--version").returncode == 0
    assert make(folder, STAMP).stdout == f"make: '{STAMP}' is up to date.\n"


def test_a_step_that_fails_shows_why_and_is_tried_again(folder_with_pip):
    folder = folder_with_pip
    for _ in range(2):
        ended = make(folder, ".venv/messages.stamp")
        assert ended.returncode == 2
        step, *shown, end = ended.stdout.splitlines()
        assert step.startswith("Installing ROS 2 Jazzy from PyPI, ")
        assert any(line.startswith("ERROR: ") for line in shown)
        assert end.startswith("This step failed, .venv/install.log has all of its output.")
    assert not (folder / ".venv" / "messages.stamp").exists()


def test_ctrl_c_ends_a_step_and_all_its_processes(folder_with_pip):
    folder = folder_with_pip
    provide_project(folder, "hanging", HANGING)
    command = ["make", ".venv/messages.stamp"]
    started = subprocess.Popen(command, cwd=folder, env=environment(), start_new_session=True)
    try:
        until((folder / "messages" / "begun").exists)
        os.killpg(started.pid, signal.SIGINT)  # as a terminal does
        assert started.wait(DEADLINE_S) != 0
        until(lambda: not group_lives(started.pid))
    finally:
        if group_lives(started.pid):
            os.killpg(started.pid, signal.SIGKILL)
    assert not (folder / ".venv" / "messages.stamp").exists()


def group_lives(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True
