"""Allocations that fail, one by one, in the extensions as users have them: MemoryError, and nothing else."""

import json
import platform
import subprocess
import sys

import pytest
from interposing import built, with_library
from processes import PROGRAMS

pytestmark = [
    pytest.mark.ours,
    pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="stands in for glibc's functions"),
]
# What must be reached, so that no change of an operation makes this test one of nothing.
LEAST = {"engine": 900, "all": 250}


def injections(scope, folder, *operations):
    """What `programs/allocations.py` prints: of each operation a dict."""
    variables = {"PYTHONMALLOC": "malloc"} if scope == "all" else {}
    done = subprocess.run(
        [sys.executable, str(PROGRAMS / "allocations.py"), scope, *operations],
        env=with_library(built("allocations", folder), **variables),
        text=True,
        capture_output=True,
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.parametrize("scope", LEAST)
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
    # The entries of the message, its copy, and each new name.
    assert len(failures) >= 10
    assert any(one["missing"] for one in failures)
    assert not all(one["missing"] for one in failures)
    assert "Receiving transforms failed" in done.stderr
    assert "MemoryError" in done.stderr


def table(results):
    """One line for each operation: its allocations, and how often one failed."""
    lines = [f"{'operation':45} allocations  injected"]
    for one in results:
        told = f"  {len(one['found'])} wrong" if one["found"] else ""
        lines.append(f"{one['operation']:45} {one['allocations']:11} {one['injected']:9}{told}")
    lines.append(f"{len(results)} operations, {sum(one['injected'] for one in results)} injections")
    return "\n".join(lines)
