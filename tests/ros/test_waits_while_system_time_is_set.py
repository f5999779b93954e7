# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The time of day is set: timeouts count steady time, nothing hangs or spins, a step back clears a buffer."""

import json

import pytest
from interposed_libraries import output_with_library
from waiting import PROMPT_S

TIMEOUT_S = 0.4
# Of processor time after the step: a wait takes some milliseconds, and a loop that spins most of the timeout.
WORK_S = 0.1

EXPIRED = {
    "blocking": "LookupException",
    "can": False,
    "awaiting": "TimeoutException",
    "in_an_executor": "TimeoutException",
    "filtering": "TIMEOUT",
}
ANSWERED = {**dict.fromkeys(EXPIRED, "map"), "can": True}


@pytest.mark.parametrize("seconds", [3600, -3600])
def test_the_time_of_day_is_set_during_waits(tmp_path, seconds):
    lines = output_with_library(
        "time_of_day", tmp_path, seconds, TIMEOUT_S, program="waits_while_system_time_is_set"
    ).splitlines()
    found = {one.pop("what"): one for one in map(json.loads, lines)}
    for way in EXPIRED:
        expired, answered = found[way], found[f"{way}, then inserts"]
        assert expired["outcome"] == EXPIRED[way]
        assert TIMEOUT_S <= expired["s"] < PROMPT_S, (way, expired)  # a busy machine is late, and not an hour
        assert answered["outcome"] == ANSWERED[way]
        assert answered["s"] < PROMPT_S, (way, answered)
        assert expired["cpu_s"] < WORK_S, (way, expired)
    assert found["receives 1"]["outcome"] and found["receives 2"]["outcome"]
    assert found["spin_once"]["outcome"] == "TimeoutException"
    assert TIMEOUT_S <= found["spin_once"]["s"] < PROMPT_S


@pytest.mark.parametrize(
    ("back_s", "has_source", "max_age", "samples"),
    [(3600, 1, 5, 0), (1, 1, 5, 0), (0.5, 1, 5, 1), (3600, 0, 5, 1), (3600, 1, 0, 1)],
)
def test_a_step_back_clears_what_a_source_fills(tmp_path, back_s, has_source, max_age, samples):
    how = tmp_path, back_s, has_source, max_age
    assert int(output_with_library("time_of_day", *how, program="sets_system_time_back")) == samples
