# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The real tf2, beside which `pytest --reference` runs the tests marked `tf2`."""

import importlib
import os
import re
import sys
from pathlib import Path

import pytest
from paths import ROOT

# Of the real tf2, such as (0, 36, 20) of Jazzy; None: the tests are those of this project.
release = None


def reveal():
    """Let this process and the tests' own programs import the real tf2 instead of this project."""
    sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() != ROOT]
    editable = [finder for finder in sys.meta_path if "__editable__" in getattr(finder, "__module__", "")]
    sys.meta_path[:] = [
        finder
        for finder in sys.meta_path
        if finder not in editable and getattr(finder, "__module__", "") != "tf2_ros_cython._finder"
    ]
    os.environ["TF2_ROS_CYTHON"] = "0"
    os.environ["PYTHONPATH"] = os.pathsep.join(
        entry for entry in os.environ["PYTHONPATH"].split(os.pathsep) if entry != str(ROOT)
    )
    try:
        tf2_py = importlib.import_module("tf2_py")
    except ModuleNotFoundError:
        raise pytest.UsageError("--reference: there is no tf2_py here; source a ROS 2 first") from None
    if hasattr(tf2_py.BufferCore, "statistics"):
        raise pytest.UsageError(f"--reference: {tf2_py.__file__} is this project's own tf2_py")
    global release
    release = _release_of(Path(tf2_py.__file__))


def _release_of(module):
    # <prefix>/lib/python3.12/site-packages/tf2_py/__init__.py; Debian calls the last folders otherwise.
    manifest = module.parents[4] / "share" / "tf2_py" / "package.xml"
    if not manifest.exists():
        raise pytest.UsageError(f"--reference: no {manifest}, which states the release of {module}")
    stated = re.search(r"<version>(\d+)\.(\d+)\.(\d+)</version>", manifest.read_text(encoding="utf-8"))
    return tuple(map(int, stated.groups()))


def holds(series):
    """Whether what holds for the real tf2 of these series, such as "0.36", holds for the one in use."""
    return f"{release[0]}.{release[1]}" in series


def imported(name):
    """A module of the tf2 under test. If it needs a package that this ROS 2 does not have, skip the tests."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as missing:
        if missing.name != "sensor_msgs_py":
            raise
    pytest.skip("sensor_msgs_py is absent", allow_module_level=True)
