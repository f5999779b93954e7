# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run the tests' programs with libraries that replace functions of the C library."""

import os
import platform
import shutil
import subprocess

import pytest
from paths import PROGRAMS, SUPPORT
from processes import output_of


def output_with_library(name, folder, *arguments, program=None, **variables):
    """
    Run `programs/<name>.py` with `interposed/<name>.c`, compiled into a folder; its standard output.

    :param program: another name in `programs`, or a path without its suffix.
    :param variables: of the environment.

    Without glibc or a compiler the test is skipped.
    """
    environment = with_library(name, folder) | variables
    return output_of(PROGRAMS / f"{program or name}.py", *arguments, env=environment)


def with_library(name, folder):
    """The environment of a program with `interposed/<name>.c`, which this compiles; as above."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or platform.libc_ver()[0] != "glibc":
        pytest.skip("there is no glibc, or no C compiler")
    library, source = folder / f"{name}.so", SUPPORT / "interposed" / f"{name}.c"
    options = ["-std=gnu11", "-Wall", "-Wextra", "-Werror", "-O2", "-shared", "-fPIC"]
    subprocess.run([compiler, *options, "-o", library, source, "-ldl"], check=True)
    # After the runtime of a sanitizer, which must be the first.
    preload = f"{os.environ.get('LD_PRELOAD', '')} {library}".strip()
    return {**os.environ, "LD_PRELOAD": preload}
