# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures and options are those of the core's suite_plugin.py; programs also find the tools."""

import os

import pytest
from tool_paths import SUPPORT, TOOLS

pytest_plugins = ["suite_plugin"]

# For the tests' own programs.
os.environ["PYTHONPATH"] = os.pathsep.join([str(TOOLS), str(SUPPORT), os.environ.get("PYTHONPATH", "")])

# Helpers that assert.
pytest.register_assert_rewrite("shared_feed_tests", "starting_programs")
