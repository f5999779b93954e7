"""Allocations that fail, one by one, in the extensions as users have them: MemoryError, and nothing else."""

import json
import platform
import subprocess
import sys

import pytest
from failing_allocations import injections, table
from interposing import built, with_library
from paths import PROGRAMS

pytestmark = [
    pytest.mark.ours,
    pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="stands in for glibc's functions"),
]
# What must be reached, so that no change of an operation makes this test one of nothing.
LEAST = {"engine": 850, "all": 250}


@pytest.mark.parametrize("scope", ["engine", pytest.param("all", marks=pytest.mark.long)])
def test_a_failure_raises_and_changes_nothing(scope, tmp_path):
    results = injections(scope, tmp_path)
    print(table(results))
    wrong = {one["operation"]: one["found"] for one in results if one["found"]}
    assert wrong == {}
    assert sum(one["injected"] for one in results) >= LEAST[scope]


def test_a_failure_while_a_message_is_received_is_logged(tmp_path):
    done = subprocess.run(
        [sys.executable, str(PROGRAMS / "receives_without_memory.py")],
        env=with_library(built("allocations", tmp_path)),
        text=True,
        capture_output=True,
    )
    assert done.returncode == 0, done.stderr
    failures = [json.loads(line) for line in done.stdout.splitlines()]
    # The entries of the message, and each new name.
    assert len(failures) >= 8
    assert any(one["missing"] for one in failures)
    assert "Receiving transforms failed" in done.stderr
    assert "MemoryError" in done.stderr
