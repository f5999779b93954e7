"""The fixtures and options are those of tests/support/suite.py of the core; programs also find the tools."""

import os

import pytest
from tool_paths import SUPPORT, TOOLS

pytest_plugins = ["suite", "fastdds_log"]

# For the tests' own programs.
os.environ["PYTHONPATH"] = os.pathsep.join([str(TOOLS), str(SUPPORT), os.environ.get("PYTHONPATH", "")])

# Helpers that assert.
pytest.register_assert_rewrite("starting_programs")
