# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What `build_ext` says: how far it is, and which modules Cython refuses."""

import os
import sys

import pytest
from paths import ROOT
from processes import run

SETUP = """
import sys
from pathlib import Path

from setuptools import setup

from build_backend import extensions

folder = Path.cwd()
setup(
    name="small",
    version="1",
    packages=extensions.packages(folder),
    ext_modules=extensions.cython_extensions(folder),
    cmdclass={"build_ext": extensions.BuildExtensions},
    script_args=["-q", "build_ext", "--inplace"],
)
"""


@pytest.fixture
def build(tmp_path):
    """Build a package of these modules; what the build ended with, and the lines that say how far it is."""
    (tmp_path / "setup.py").write_text(SETUP)
    for package in ("tf2_small", "tf2_ros_cython"):  # the build writes its version into the other one
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").touch()
    progress = tmp_path / "progress"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "BUILD_PROGRESS": str(progress), "CFLAGS": "-O0"}

    def build(**modules):
        for name, source in modules.items():
            (tmp_path / "tf2_small" / f"{name}.pyx").write_text(source)
        progress.unlink(missing_ok=True)
        done = run(sys.executable, "setup.py", cwd=tmp_path, env=environment)
        return done, progress.read_text().splitlines() if progress.exists() else []

    return build


def test_a_module_that_cython_refuses_is_named_and_the_others_are_built(build, tmp_path):
    done, lines = build(broken="def f(:\n", good="x = 1\n")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == "Cython refused tf2_small.broken; what it says is above"
    assert "Expected" in done.stderr + done.stdout
    assert [line.partition(": ")[2] for line in lines] == ["tf2_small.good"]
    assert len(list((tmp_path / "tf2_small").glob("*.so"))) == 1
