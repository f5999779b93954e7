# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The pyproject.toml and the packages of the tools; see `project_sources.py` of the core."""

import sys

from tool_paths import TOOLS

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PYPROJECT = tomllib.loads((TOOLS / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES = ("tf2_ros_tools",)
