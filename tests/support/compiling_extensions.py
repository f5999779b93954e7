# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compile extensions that tests use."""

import importlib.util
import os
import shutil
import sys
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from paths import ROOT, SUPPORT
from processes import run


@cache
def compiled(name):
    """A module of tests/support/compiled, compiled for this process."""
    folder = Path(mkdtemp(prefix="tf2-ros-cython-compiled-"))
    shutil.copy(SUPPORT / "compiled" / f"{name}.pyx", folder)
    done = run(
        *(sys.executable, "-m", "Cython.Build.Cythonize", "--inplace", "--quiet", "-3", f"{name}.pyx"),
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    [library] = folder.glob(f"{name}.*.so")
    spec = importlib.util.spec_from_file_location(name, library)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    shutil.rmtree(folder)
    return module
