# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Recordings of what arrives, where the middleware lacks something.

`interposed/faulty_middleware.c` of the core's tests takes it away from the one that the tests run with.
"""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from interposed_libraries import output_with_library

REFUSED = "1 transform of map by {} is refused: frame_id and child_frame_id are the same"


@pytest.fixture
def recorded_with(tmp_path):
    """What `records_with_faulty_middleware.py` prints after so many messages, with a fault."""

    def run(fault, messages):
        program = Path(__file__).with_name("records_with_faulty_middleware")
        variables = {"TF2_TEST_MIDDLEWARE": fault}
        return json.loads(
            output_with_library("faulty_middleware", tmp_path, str(messages), program=program, **variables)
        )

    return run


def test_where_arrivals_are_not_reported_nothing_can_be_recorded(recorded_with):
    reason = "recording= does not work with this listener: the middleware does not report arrivals"
    assert recorded_with("no_arrivals", 1) == {"error": reason, "subscriptions": 0}


@pytest.mark.parametrize("fault", ["no_times", "times_of_taking"])
def test_the_time_of_reception_is_that_of_the_arrival(recorded_with, flood, fault):
    """Not that at which several messages are taken together."""
    rate = 50
    flood(rate, 1)
    before_ns = time.time_ns()
    # After those of the time before the subscriber was discovered, which arrive at once.
    received_ns = recorded_with(fault, 150)["received_ns"][-100:]
    assert before_ns < received_ns[0] and received_ns[-1] < time.time_ns()
    together = np.diff(received_ns) < 10**9 / rate / 10
    assert np.count_nonzero(together) < len(together) / 2


class TestPublishersThatTheGraphDoesNotKnow:
    @pytest.fixture(autouse=True)
    def publishers(self, peer):
        peer().send_without_subscriber(("map", "map", 0, 0), ("map", "arm", 0, 0), static=True)
        peer().send_without_subscriber(("robot", "arm", 0, 0), static=True)

    def test_without_gids_all_are_one_that_exists(self, recorded_with):
        recorded = recorded_with("no_gids", 2)
        assert recorded["publishers"] == {"arm": "an unknown publisher"}
        assert REFUSED.format("an unknown publisher") in recorded["findings"]

    def test_with_other_gids_they_are_told_apart(self, recorded_with):
        findings = recorded_with("local_gids", 2)["findings"]
        [by_several] = [one for one in findings if one.startswith("arm is published by 2 publishers: ")]
        names = by_several.rpartition(": ")[2].split(", ")
        assert len({*names}) == 2 and all(name.endswith("..00000000") for name in names)
        assert sum(REFUSED.format(name) in findings for name in names) == 1
