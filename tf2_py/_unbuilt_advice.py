# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Advice for an import of tf2_py whose compiled modules are missing, or are for another Python."""

import os
import re
import sys


def advice() -> str:
    """Where the package is, for which Python it is built, and what to do."""
    package = os.path.dirname(os.path.abspath(__file__))
    home = os.path.dirname(package)
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    if not os.path.isfile(os.path.join(home, "setup.py")):
        built_for = _built_for(package)
        if built_for is None:
            return f"{home} lacks it. With {sys.executable}, reinstall tf2-ros-cython"
        return (
            f"{home} is built for {built_for}, but this is Python {version}, {sys.executable}. Start the "
            "other Python, remove the folder from PYTHONPATH, or install tf2-ros-cython into this one"
        )
    text = f"{home} is not built for Python {version}"
    for folder in map(os.path.abspath, sys.path):
        if folder != home and os.path.isfile(os.path.join(folder, "tf2_py", "__init__.py")):
            text += f", and hides the tf2_py in {folder}"
            return f"{text}. Change to another directory, or run `make build` in {home}"
    return f"{text}. Run `make build` there, or `pip install .` and then change to another directory"


def _built_for(package: str) -> str | None:
    """The Python and the machine of the compiled modules, or None if there are none."""
    for name in sorted(os.listdir(package)):
        if found := re.match(r"_tf2_py\.cpython-3(\d+)-?(.*)\.so$", name):
            return f"Python 3.{found[1]} ({found[2]})"
    return None
