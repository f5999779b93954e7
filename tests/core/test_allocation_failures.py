# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Allocations that fail, in the extensions as users have them: MemoryError, and nothing else."""

import json
import os

import pytest
from interposed_libraries import output_with_library

pytestmark = pytest.mark.ours

# More of them search for longer, from another seed.
STEPS = int(os.environ.get("ALLOCATION_STEPS", "2000"))
SEED = int(os.environ.get("ALLOCATION_SEED", "1"))


def test_a_failure_raises_and_changes_nothing(tmp_path):
    failures = json.loads(output_with_library("failing_allocations", tmp_path, SEED, STEPS))
    assert all(failures[step] for step in ("insert", "insert_many", "replace", "restore"))
    assert sum(failures.values()) > STEPS // 20
