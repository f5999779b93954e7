"""What ends a test that hangs."""

import sys

import pytest
from processes import run

pytestmark = pytest.mark.ours

CONFTEST = """
import suite_fixtures

suite_fixtures.HUNG_IN_C_S = 1
pytest_plugins = ["suite_fixtures"]
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


@pytest.mark.parametrize("library", ["PyDLL", "CDLL"])  # the first one holds the GIL
def test_a_test_that_hangs_in_c_ends_the_run_which_says_where(library, tmp_path):
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_hanging.py").write_text(HANGS.format(library))
    options = ("--timeout=1", "--timeout-method=signal", "-p", "no:cacheprovider")
    done = run(sys.executable, "-m", "pytest", *options, tmp_path, cwd=tmp_path)
    assert done.returncode == 1
    assert "line 8 in test_hangs" in done.stderr, done.stderr
    assert "passed" not in done.stdout
