# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What ends a test that hangs."""

import sys

import pytest
from processes import run

pytestmark = pytest.mark.ours

CONFTEST = """
import suite_plugin

suite_plugin.PROBE_S, suite_plugin.HUNG_S = 1, 8
pytest_plugins = ["suite_plugin"]
"""
HANGS = """
import ctypes


def test_hangs():
    library, mutex = ctypes.{}(None), ctypes.create_string_buffer(64)
    for _ in range(2):
        library.pthread_mutex_lock(mutex)


def test_is_not_run():
    pass
"""
SLOW = """
import threading


def test_is_slow():
    threading.Event().wait(10)


def test_is_too_slow():
    threading.Event().wait(60)


def test_is_run():
    pass
"""


@pytest.fixture
def ended(tmp_path):
    """Run tests, and end."""

    def run_pytest(code):
        (tmp_path / "conftest.py").write_text(CONFTEST)
        (tmp_path / "test_here.py").write_text(code)
        options = ("--timeout=15", "--timeout-method=signal", "-p", "no:cacheprovider")
        return run(sys.executable, "-m", "pytest", *options, tmp_path, cwd=tmp_path)

    return run_pytest


@pytest.mark.parametrize("library", ["PyDLL", "CDLL"])  # the first one holds the GIL
def test_a_test_that_hangs_in_c_ends_the_run_which_says_where(library, ended):
    done = ended(HANGS.format(library))
    assert done.returncode == 1
    assert "line 8 in test_hangs" in done.stderr, done.stderr
    assert "passed" not in done.stdout


@pytest.mark.long("waits for half a minute")
def test_a_slow_test_passes_and_one_that_is_too_slow_fails_alone(ended):
    done = ended(SLOW)
    assert "test_is_too_slow - Failed: Timeout (>15.0s)" in done.stdout, done.stdout + done.stderr
    assert "1 failed, 2 passed" in done.stdout
