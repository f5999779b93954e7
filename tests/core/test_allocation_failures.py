# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Allocations that fail, in the extensions as users have them: MemoryError, and nothing else."""

import json

import pytest
from interposed_libraries import output_with_library
from paths import PROGRAMS
from processes import output_of
from random_runs import first_seed, times

STEPS = times(500, 2000)


@pytest.mark.repeated
def test_a_failure_raises_and_changes_nothing(tmp_path):
    failures = json.loads(output_with_library("failing_allocations", tmp_path, first_seed(), STEPS))
    assert all(failures[step] for step in ("insert", "insert_many", "replace", "restore"))
    assert sum(failures.values()) > STEPS // 20


def test_a_wait_whose_transform_is_inserted_ends_without_memory():
    pytest.importorskip("_testcapi")
    assert output_of(PROGRAMS / "no_memory_at_delivery.py") == "True False\n"
