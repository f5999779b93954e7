# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Find the interpreters for which wheels are built."""

import shutil
import subprocess
import sys
from pathlib import Path

VERSIONS = ("3.10", "3.11", "3.12", "3.13", "3.14")


def interpreters(paths=()):
    """
    By version, the path of an interpreter, or None where none is found.

    :param paths: of interpreters that are used instead of those found.
    """
    found = {version: _find(version) for version in VERSIONS}
    return found | {_version_of(path): str(Path(path).absolute()) for path in paths}


def _find(version):
    if sys.version_info[:2] == tuple(map(int, version.split("."))):
        return sys.executable
    below = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python"))
    # A pyenv's own shim in PATH only says that no version is chosen.
    in_path = shutil.which(f"python{version}")
    for python in (*map(str, reversed(below)), in_path):
        if python is not None and _version_of(python) == version:
            return python
    return None


def _version_of(python):
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    told = subprocess.run([python, "-c", code], capture_output=True, text=True)
    return told.stdout.strip()
