"""In a free-threaded Python, the extensions have the GIL enabled, and work as in others."""

import shutil
import subprocess

import pytest
from installing import checkout_copy, unsourced
from paths import ROOT
from sources import PYPROJECT

pytestmark = [
    pytest.mark.ours,
    pytest.mark.long("builds the project for a free-threaded Python, if there is one"),
    pytest.mark.timeout(1200),
]

PYTHONS = ("python3.14t", "python3.13t")
OF_TESTS = ("pytest>=9", "pytest-timeout", "hypothesis", "PyYAML")
TESTS = ("conformance", "plain_buffer", "threads", "waiters")


@pytest.fixture(scope="module")
def free_threaded(tmp_path_factory):
    """Runs a free-threaded Python in a copy of the checkout that is built for it."""
    found = next(filter(None, map(shutil.which, PYTHONS)), None)
    if found is None:
        pytest.skip(f"there is none of {', '.join(PYTHONS)}")
    folder = tmp_path_factory.mktemp("free_threaded")
    project = checkout_copy(folder / "project")
    shutil.copytree(ROOT / "tests", project / "tests", ignore=shutil.ignore_patterns("__pycache__"))
    python = folder / "venv" / "bin" / "python"

    def run(*arguments):
        command = [python, *arguments]
        ended = subprocess.run(command, cwd=project, env=unsourced(), text=True, capture_output=True)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        return ended.stdout

    subprocess.run([found, "-m", "venv", folder / "venv"], check=True)
    of_build = [one.partition(";")[0] for one in PYPROJECT["build-system"]["requires"]]
    # Newer NumPys have no wheel for 3.13t.
    run("-m", "pip", "install", "--quiet", "--prefer-binary", *of_build, *OF_TESTS)
    run("setup.py", "-q", "build_ext", "--inplace")
    return run


def test_the_gil_is_enabled_by_the_import(free_threaded):
    program = (
        "import sys; before = sys._is_gil_enabled(); import tf2_py; print(before, sys._is_gil_enabled())"
    )
    assert free_threaded("-c", program) == "False True\n"


def test_the_tests_that_need_no_ros_pass(free_threaded):
    files = [f"tests/core/test_{name}.py" for name in TESTS]
    assert " passed" in free_threaded("-m", "pytest", "-q", "-p", "no:cacheprovider", *files)
