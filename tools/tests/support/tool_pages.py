# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The pages of the tools, and running their programs beside the samples; as `documentation_pages.py`."""

import importlib.util
import shutil
import sys

import documentation_pages
from tool_paths import DOCS, SAMPLES, SUPPORT, TOOLS

PAGES = [TOOLS / "README.md", *sorted(DOCS.rglob("*.md"))]
# Those that show programs of the tools.
ALL_PAGES = [*documentation_pages.PAGES, *PAGES]


def run_program(page, folder, python=sys.executable, environment=None):
    """Run the program of a page in a folder, beside the samples; it must print what the page says."""
    shutil.copytree(SAMPLES, folder, dirs_exist_ok=True)
    documentation_pages.run_program(page, folder, python, environment)


def provide_torch(folder):
    """Put a stand-in for torch next to the programs of a folder, if it is not installed."""
    if importlib.util.find_spec("torch") is None:
        shutil.copytree(SUPPORT / "standins" / "torch", folder / "torch")
