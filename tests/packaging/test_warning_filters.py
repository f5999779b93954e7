# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which warnings fail a test: `filterwarnings` in the pyproject.toml of both suites."""

import re
import sys

import pytest
from paths import ROOT
from processes import run

pytestmark = pytest.mark.ours

OUTCOMES = """
import gc, threading, warnings

from excused_faults import KnownFault

def warn_of_module(module, text, category):
    warnings.warn_explicit(text, category, f"{module}.py", 1, module)

def test_failed_user_warning(): warnings.warn("unwanted")
def test_failed_own_deprecation(): warn_of_module("tf2_ros.buffer", "old", DeprecationWarning)
def test_failed_deprecation_of_a_test(): warnings.warn("old", DeprecationWarning)
def test_failed_unclosed_file(): open(__file__); gc.collect()
def test_failed_exception_in_a_thread():
    thread = threading.Thread(target=lambda: 1 / 0)
    thread.start()
    thread.join()
def test_failed_system_exit_in_a_thread():
    def leave(): raise SystemExit("mine")
    thread = threading.Thread(target=leave)
    thread.start()
    thread.join()

def test_passed_known_fault(): warnings.warn(KnownFault("of the middleware"))
def test_passed_deprecation_of_a_library(): warn_of_module("lark.utils", "old", DeprecationWarning)
def test_passed_warning_of_rclpy():
    warn_of_module("rclpy.service", "failed to send response (timeout)", RuntimeWarning)
def test_passed_fork():
    text = "This process (pid=1) is multi-threaded, use of fork() may lead to deadlocks in the child."
    warnings.warn(text, DeprecationWarning)
"""


@pytest.mark.parametrize("suite", ["", "tools"])
def test_a_warning_fails_the_test_unless_it_is_excused(tmp_path, suite):
    configuration = ROOT / suite / "pyproject.toml"
    if not configuration.exists():
        pytest.skip("the core alone")
    program = tmp_path / "test_outcomes.py"
    program.write_text(OUTCOMES)
    options = ["-c", configuration, "--rootdir", tmp_path, "-p", "no:cacheprovider", "-p", "no:xdist", "-rA"]
    done = run(sys.executable, "-m", "pytest", *options, program)
    outcomes = re.findall(r"^(PASSED|FAILED) .*::test_(passed|failed)_(\w+)", done.stdout, re.M)
    assert len(outcomes) == OUTCOMES.count("def test_")
    assert [name for outcome, expected, name in outcomes if outcome.lower() != expected] == []
    assert "KnownFault: of the middleware" in done.stdout
