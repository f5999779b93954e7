# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The program tf2_which, wherever it is installed; test_sourced_ros.py has it beside a sourced ROS."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from paths import ROOT
from waiting import DEADLINE_S

from tf2_ros_cython import which


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")
@pytest.mark.parametrize(
    ("device", "said"), [("/dev/full", "tf2_which: No space left on device\n"), (None, "")]
)
@pytest.mark.parametrize("arguments", [[], ["-h"]], ids=["answer", "help"])
def test_output_that_cannot_be_written_is_one_line_and_status_1(device, said, arguments, monkeypatch):
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    reading, writing = os.pipe()
    os.close(reading)  # a reader who leaves
    out = writing if device is None else os.open(device, os.O_WRONLY)
    command = [sys.executable, "-m", "tf2_ros_cython", *arguments]
    done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, timeout=DEADLINE_S)
    assert (done.returncode, done.stderr) == (1, said)
    for one in {out, writing}:
        os.close(one)


def test_the_answer_does_not_need_standard_output():
    command = [sys.executable, "-m", "tf2_ros_cython"]
    how = {"capture_output": True, "text": True, "timeout": DEADLINE_S}
    usual = subprocess.run(command, **how)
    closed = subprocess.run(command, **how, preexec_fn=lambda: os.close(1))
    assert (closed.returncode, closed.stdout, closed.stderr) == (usual.returncode, "", usual.stderr)


def test_a_module_with_the_name_of_a_package_is_named(tmp_path):
    file = tmp_path / "tf2_ros.py"
    file.write_text("print(__file__)")
    imported, told = (
        subprocess.run([sys.executable, *command], cwd=tmp_path, capture_output=True, text=True)
        for command in (["-c", "import tf2_ros"], ["-m", "tf2_ros_cython"])
    )
    assert (imported.stdout, told.returncode) == (f"{file}\n", 1)
    assert f"\ntf2_ros: not a package, but the module {file}: rename it\n" in told.stdout
    assert "not installed" not in told.stdout.partition("\ntools: ")[0]


def test_a_variable_that_has_no_effect_is_named(monkeypatch):
    monkeypatch.setenv("TF2_ROS_CYTHON", "0")
    told = subprocess.run([sys.executable, "-m", "tf2_ros_cython"], capture_output=True, text=True).stdout
    expected = "because TF2_ROS_CYTHON=0 is set; without another tf2, tf2-ros-cython is used\n"
    assert f"\nprecedence: the order of sys.path, {expected}" in told


@pytest.mark.skipif(Path(which.__file__).parents[1] != ROOT, reason="what is installed has no sources")
def test_sources_of_another_version_than_the_build_are_named(monkeypatch, capsys):
    built = which.__version__
    monkeypatch.setattr(which, "__version__", "0.0.1")
    which.main(["tf2_which"])
    said = f"version: tf2-ros-cython 0.0.1 (but the sources are {built}: run `make build` in {ROOT})"
    assert capsys.readouterr().out.splitlines()[-1].startswith(said)
    monkeypatch.undo()
    which.main(["tf2_which"])
    assert f"version: tf2-ros-cython {built}, " in capsys.readouterr().out
