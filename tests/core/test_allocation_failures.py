"""Allocations that fail, in the extensions as users have them: MemoryError, and nothing else."""

import json
import os
import platform
import subprocess
import sys

import pytest
from interposing import built, with_library
from paths import PROGRAMS

pytestmark = [
    pytest.mark.ours,
    pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="stands in for glibc's functions"),
]
# More of them search for longer, from another seed.
STEPS = int(os.environ.get("ALLOCATION_STEPS", "2000"))
SEED = int(os.environ.get("ALLOCATION_SEED", "1"))


def run(folder, program, *arguments):
    return subprocess.run(
        [sys.executable, str(PROGRAMS / program), *map(str, arguments)],
        env=with_library(built("allocations", folder)),
        text=True,
        capture_output=True,
    )


def test_a_failure_raises_and_changes_nothing(tmp_path):
    done = run(tmp_path, "allocations.py", SEED, STEPS)
    assert done.returncode == 0, done.stderr
    failures = json.loads(done.stdout)
    assert failures["insert"] and failures["insert_many"] and failures["restore"]
    assert sum(failures.values()) > STEPS // 20
