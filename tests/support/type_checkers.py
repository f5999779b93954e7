# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Type checkers: what they say of programs in a folder, in processes of their own."""

import json
import os
import re
import sys
from pathlib import Path

from documentation_pages import blocks, program
from paths import ROOT
from processes import run

# Its program is for an environment without ROS 2, where messages have no types.
WITHOUT_ROS = "installing.md"
# Has mypy's settings. Messages have no types: mypy takes them for Any, pyright reads their source.
SETTINGS = ROOT / "docs" / "tests-and-types.md"
# The wrapper of pyright fetches nothing.
OFFLINE = {"PYRIGHT_PYTHON_USE_BUNDLED_PYRIGHT": "1", "PYRIGHT_PYTHON_IGNORE_WARNINGS": "1"}


def run_module(folder, module, *arguments, **environment):
    # Of what the environment says to the wrapper of pyright, nothing may make it fetch another one.
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYRIGHT_")}
    return run(sys.executable, "-m", module, *arguments, cwd=folder, env=kept | environment)


def write_programs(folder, pages):
    """Make it a folder where a user works: the programs of pages, and the settings that the docs advise."""
    for page in pages:
        if program(page) and page.name != WITHOUT_ROS:
            (folder / f"page_{page.stem.replace('-', '_')}.py").write_text(program(page))
    [settings] = [block.code for block in blocks(SETTINGS) if block.language == "toml"]
    (folder / "pyproject.toml").write_text(settings)


def _programs(folder):
    return sorted(path.name for path in folder.glob("*.py"))


def by_mypy(folder, *_):
    # On PYTHONPATH, and not on mypy's own path, this project is what an installed package is. The option
    # overrides the setting that allows calls of untyped functions: this project has none. What mypy knows of
    # NumPy and of rclpy is kept for the next test.
    options = ["--strict", f"--cache-dir={ROOT / 'build' / 'mypy'}"]
    ended = run_module(folder, "mypy", *options, *_programs(folder))
    assert ended.returncode in (0, 1), ended.stdout + ended.stderr
    return re.findall(r"^(\S+):(\d+): error: (.*)$", ended.stdout, re.MULTILINE)


def by_pyright(folder, *more):
    """:param more: folders with packages, besides that of the project."""
    paths = [str(one) for one in (ROOT, *more)]
    (folder / "pyrightconfig.json").write_text(json.dumps({"extraPaths": paths}))
    options = ["--outputjson", "--pythonpath", sys.executable]
    ended = run_module(folder, "pyright", *options, *_programs(folder), **OFFLINE)
    assert ended.returncode in (0, 1), ended.stdout + ended.stderr
    return [
        (Path(one["file"]).name, one["range"]["start"]["line"] + 1, one["message"])
        for one in json.loads(ended.stdout)["generalDiagnostics"]
        if one["severity"] == "error"
    ]


def unexpected(errors):
    """The errors of the programs of pages that are not about what these leave out because they are short."""
    # Some functions in them have no annotations. SciPy, pandas and messages have no types.
    accepted = r"\[(no-untyped-(def|call)|no-any-return|import-untyped)\]$"
    return [error for error in errors if not re.search(accepted, error[2])]
